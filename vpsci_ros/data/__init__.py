"""Near misses from recordings, and dataset files from the simulation.

`episode` is the type of an episode, recorded or simulated. `episode_block` collects simulated episodes tick by tick,
`filters` selects them, `dataset_tables` has their columns, `dataset` writes them, and `dataset_reader` reads them.
`near_misses` is the table of recorded near misses, `importers` fill it from published data, `reference` works out the
columns that follow from others, `recorded` makes episodes of the table, and `interactions` holds it as arrays.
"""
