"""Figures, HTML pages and summaries of datasets, recordings, training logs, trajectories and scenarios.

`summary` counts per scenario, `trajectories` draws episodes as in Figure 7. Import from the modules; some need no
matplotlib.
"""
