"""The paper's studies (Tables 3, 9), section 4 and Turing test, its authors' files, and measures of realism.

In reading order:

* `study_commands`: the commands `vpsci study`, `vpsci turing` and `vpsci published`
* `published`: values published in the paper: Tables 3, 9 and 11, and two of section 4
* `published_dataset`: importer of the simulated episodes that the paper's authors publish
* `published_tables`: the authors' dataset as they publish it: CSV files named as in Table 6
* `models`: the models of the paper's Table 9, found by entry points, and their layers in place of the SST's
* `rule_based`: the rule-based pair from recorded onsets: a pedestrian of the social force model, and a car that brakes
* `rates`: Table 5's rates of collisions and goals among critical episodes, with intervals
* `trajectories`: trajectories in the manner of the paper's Figure 7: vehicle blue, pedestrian red
* `min_ade`: minADE: the expected least error of some of the roll-outs
"""
