"""Additions to the exam: search for rare failures, explanation of failures, a standard protocol, a socket.

In reading order:

* `ads_commands`: the commands `vpsci ads-search`, `ads-why`, `ads-compare`, `ads-protocol` and `ads-socket`
* `why`: the least change that avoids a failure, found by repeating the episode with one change at a time
* `factors`: the factors that can be changed when a failed episode is repeated, and their ranges
* `explain`: explanation of an exam's failures: repeated runs in EXAM/why, a report, and a page that plays them
* `side_by_side`: exams of several systems on the same episodes: one table, paired differences, and an order
* `protocol`: run of a standard protocol: its tests driven, rated, and compared with an exam
* `euro_ncap`: Euro NCAP's car-to-pedestrian tests as far as a kinematic world can run them: definitions and points
* `socket_driver`: a driving system behind a TCP socket on this machine's loopback: the exam in any language
"""
