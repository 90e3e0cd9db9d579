"""The paper's studies: Tables 3 and 9 beside its values; each can be resumed.

In reading order:

* `run_studies`: studies of learning as commands: Tables 3 and 9 beside the paper's values
* `learning`: Table 3 of the paper: how much real data stage 1 needs
* `model_comparison`: Table 9 on given near misses: all of the table's models, with and without hybrid learning
* `model_table`: each row of Table 9 on held-out clips, pooled over folds
* `folds`: folds by clip: every clip is held out in one fold, and errors of all folds are pooled
* `networks`: the training of each network of `policy.models` for `vpsci study models`
* `state`: the stored results of a study, so that a resumed study computes only missing ones
* `tables`: Table 3 beside the paper's values, as text
* `table_9_page`: Table 9 as a page in Markdown: all columns, the main ones with intervals
* `paper`: all figures and tables of the paper that can be drawn from a dataset and from results of other commands
"""
