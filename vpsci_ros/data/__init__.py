"""Near misses from recordings, and dataset files from the simulation.

`near_misses` is the table of recorded near misses, `importers` fill it from published data, `reference` works out the
columns that follow from others, `interactions` holds the table as arrays. `episode_block` collects simulated episodes
tick by tick, `filters` selects them, `dataset` writes them by Tables 6 and 7, and `dataset_reader` reads them.
"""
