"""From files to insight: what a dataset holds, who yielded in it, and pictures of its trajectories.

`yields` puts Table 7's columns into the form that the safety room judges, `summary` counts per scenario, `panels`
chooses typical episodes, `figures` draws them as in the paper's Figure 7, and `export` does all of it for a bag.
`errors` and what belongs to it measures models against recordings. Import from the modules: not each needs matplotlib.
"""
