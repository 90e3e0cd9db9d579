"""Bags (MCAP): read, write, repair, export and verify, without ROS.

`reader` opens a bag (files by `mcap_file`), `ticks` reads a recorded graph tick by tick,
`episodes` and `run_record` are its text records, `writer` writes a bag and `repair` completes one of a killed
recorder. The rest are the commands of `vpsci bag`.
"""
