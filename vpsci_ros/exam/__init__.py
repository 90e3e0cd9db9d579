"""The exam of a driving system: `prepare` it, `run` it, and report its results.

`conduct` has the system meet each pedestrian, by the graph of nodes (`in_graph`) or the loop (`in_process`), in which
a class answers from a process of its own (`class_process`); either gives a `result`: episodes. `measures` makes a row
of each episode, `scores` says what is measured, `report` puts it together, `criteria` says whether it is passed,
`report_page` shows it, and `view` plays the episodes.
"""
