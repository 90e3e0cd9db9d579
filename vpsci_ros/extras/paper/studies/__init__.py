"""The paper's studies: Tables 3, 5 and 9 beside its values, and cross-validation by clip; each can be resumed.

`learning` has Tables 3 and 5, `model_comparison` Table 9 of all `networks`, `model_table` what each comes to,
`cross_validation` the held-out errors, `tables` their output, and `state` what a study has finished.
"""
