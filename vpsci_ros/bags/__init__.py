"""Bags (MCAP): read, write, repair, export and verify, without ROS.

`reader` opens a bag (files by `mcap_file`, topics by `topic_info`), `ticks` reads a recorded graph tick by tick;
`episodes` reads episodes, and `run_record` how the bag was made. `writer` writes
a bag, `simulated` simulated ticks as one. `info`, `export`, `verify` and `repair` are the commands of `vpsci bag`.
"""
