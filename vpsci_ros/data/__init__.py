"""Near misses from recordings, and dataset files from the simulation.

In reading order:

* `courses`: velocities, yaw rates and directions of motion by recorded positions and headings
* `episode`: an episode of motion, recorded or simulated: one vehicle and the pedestrians that it meets
* `episode_block`: episodes that run side by side, collected frame by frame, and blocks of those that have ended
* `filters`: the filters of a dataset: the four conditions of section 3.3 of the paper
* `dataset_tables`: the tables of a dataset: their columns, a block of episodes as rows, and rows as a block
* `dataset`: the dataset on disk: a file a scenario (name: Table 6, columns: Table 7), the index episodes.parquet
* `dataset_description`: the content of dataset.json: counts by scenario and reason, quartiles of the least CurvTTC
* `dataset_reader`: a dataset's folder read back, a row group at a time
* `near_misses`: the near-miss table: recorded interactions with CurvTTC below 5 s, one row for each step of 0.1 s
* `corpus`: the near misses of a training: its tables as one, the rows it takes of them, and the split by clips
* `recorded`: recorded interactions as episodes, from a near-miss table
* `interactions`: recorded near misses as padded arrays: observations
* `importers`: importers of recordings: each format is read as clips of tracks at 0.1 s, from which near misses are cut
* `parquet`: self-describing Parquet files: unit and description in every field, a JSON document in the schema
* `published`: values published about the paper's dataset: Table 10, section 4.3, and the generation time (3.3)
"""
