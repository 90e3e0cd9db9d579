"""Likeness of simulated interactions to people: proper scores, likelihood, two-sample test by a classifier.

Any simulator can be measured: it returns positions float64[n, K, 2, 30, 2] that follow n recorded onsets (K
roll-outs, vehicle and pedestrian, 30 steps of 0.1 s, map frame, metres; `evaluation.onsets`). `likelihood` holds the
measure of the Waymo challenge, `features` and `two_sample` the classifier's test, `controls` the naive simulators,
`same_start` and `free` Protocols A and B, `long_run` statistics for B.
"""
