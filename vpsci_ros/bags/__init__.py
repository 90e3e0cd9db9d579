"""Bags: MCAP and sqlite3 files read, written, repaired, explained, drawn, exported and verified, without ROS.

`reader` opens a bag of either storage (`mcap_file`, `sqlite_file`), `ticks` reads a recorded graph back tick by
tick, `episodes` and `run_record` are the text records in it, `writer` writes one and `repair` completes what a killed
recorder left. The rest are the commands of `vpsci bag`.
"""
