"""Figures and pages of datasets, yielding, learning and trajectories.

`page` is `vpsci report`: section 4 of the paper for a generated dataset. `summary` counts per scenario, `panels`
chooses typical episodes, `trajectories` draws them as in Figure 7. Import from the modules; some need no matplotlib.
"""
