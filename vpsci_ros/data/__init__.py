"""What comes in and what goes out: near misses from real recordings, dataset files and bags from the simulation.

`near_misses` is the one table that all recordings become, `importers` fill it from published data, `synthetic` makes a
small sample where there are none, `corpus` is what a run learns from. `episode_frames` collects simulated episodes tick
by tick, `filters` decides which are kept, `dataset` writes them as Tables 6 and 7 say and `dataset_reader` reads them
back. `bag_writer` records a graph, `bags` reads it back into the same collector, `bag_repair` completes what a killed
recorder left. Import from the modules: a node that writes bags need not load what reads tables.
"""
