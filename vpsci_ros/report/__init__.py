"""Figures, HTML pages and summaries of datasets, recordings, training logs and scenarios.

Import from the modules; some need no matplotlib.

In reading order:

* `html`: a self-contained HTML page made from a template: style, text and pictures in one file
* `canvas`: figures without a display; PNG files are written whole or not at all
* `summary`: summary of a dataset beside the paper's Table 10: episodes, path lengths, rejections, collisions
* `recordings`: a check of recordings before their import: near misses as a picture, and sizes
* `world_figures`: a picture of a scenario: lane, crosswalk, spawns, routes and goals of both agents
* `learning`: figures of a training's log: rewards, outcomes of episodes, held-out errors, losses
"""
