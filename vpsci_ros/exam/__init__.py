"""The exam of a driving system: `prepare` it, `run` it, and report its results.

`conduct` has the system meet each pedestrian, by the graph of nodes (`in_graph`) or the loop (`in_process`), in which
a class answers from a process of its own (`class_process`). `measures` makes a row of each episode, `scores`
says what is measured, `report` puts it together, `earlier` says whether it is passed, and `page` shows it.
"""
