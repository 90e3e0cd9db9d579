"""Figures and pages: what a dataset holds, who yielded in it, how learning went, and pictures of trajectories.

`page` is `vpsci report`: section 4 of the paper for a generated dataset. `summary` counts per scenario, `panels`
chooses typical episodes, `trajectories` draws them as in Figure 7. Import from the modules: not each needs matplotlib.
"""
