"""Figures and pages of datasets, yielding, learning and trajectories.

`summary` counts per scenario, `trajectories` draws episodes as in Figure 7. Import from the modules; some need no
matplotlib.
"""
