"""Likeness of simulated interactions to people: proper scores, likelihood, two-sample test by a classifier.

Any simulator can be measured: it returns positions float64[n, K, 2, 30, 2] that follow n recorded onsets (K
roll-outs, vehicle and pedestrian, 30 steps of 0.1 s, map frame, metres; `evaluation.onsets`).

In reading order:

* `measure_realism`: `vpsci realism` without its command line: its measurements
* `same_start`: Protocol A: simulators and recordings from the same recorded onsets, scored beside controls
* `free`: Protocol B: comparison of freely simulated critical episodes with recorded near misses, from the onset on
* `controls`: the names of the controls, and the mean turn: positions float64[n, K, 2, 30, 2] [m] in the map frame
* `beside_sampler`: simulators beside the residual sampler: who goes first, the other agent's recording, answers to it
* `in_front`: one agent in front of another one that is not its own: the recorded one, or one that does the same
* `order`: who goes first, and how near the two come: proper scores of roll-outs, each an array over onsets
* `forecasts`: forecasts of who goes first without a simulation: controls of the Brier score
* `motion`: motion from positions: speeds, accelerations, headings, turns, clearance, CurvTTC
* `features`: the classifier's 46 features of an interaction, from positions smoothed over 0.9 s
* `two_sample`: the two-sample test by a classifier: how gradient boosting separates simulations from unseen recordings
* `likelihood`: the likelihood of the recorded motion under a simulator's roll-outs (Waymo Open Sim Agents Challenge)
* `long_run`: statistics of whole episodes after the onset: repeated critical phases, stops, new starts and extremes
* `text`: the measures of realism as text: two tables of Protocol A (same start)
* `realism_command`: `vpsci realism`: likeness of the agents to recorded people, beside naive controls
"""
