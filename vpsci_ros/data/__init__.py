"""What comes in and what goes out: near misses from real recordings, and dataset files from the simulation.

`near_misses` is the one table that all recordings become and a run learns from, `importers` fill it from published
data, `interactions` holds it as arrays.
`episode_frames` collects simulated episodes tick by tick, `filters` decides which are kept, `dataset` writes them as
Tables 6 and 7 say and `dataset_reader` reads them back. Bags are a room of their own.
"""
