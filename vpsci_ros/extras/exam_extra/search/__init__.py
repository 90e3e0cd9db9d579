"""The search for episodes in which a driving system fails, and the estimate of their number.

Only failures of the driving system itself count.

In reading order:

* `search_exam`: a search with a driving system, and its files in a folder
* `imitation`: a surrogate model of a driving system, learned from episodes that it has driven
* `seek`: the search: drive, train and simulate the surrogate, drive likely failures, and estimate their number
* `plan`: the next episodes of a search: many where a failure is likely, a few at random
* `margin`: the margin of an episode: its distance from a failure, negative for a failure, at the resolution of a tick
* `risk`: the probability of a failure at a margin, and the estimated number of failures among undriven episodes
"""
