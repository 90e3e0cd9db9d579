"""Errors of models against recordings, by two protocols, beside naive controls.

In reading order:

* `onsets`: recorded onsets, the first steps with `curvttc_causal` below 5 s, with up to 1 s before and 3 s after each
* `predictors`: models that predict the next step of a near miss, under one interface: the learned policies
* `simulators`: simulators that continue recorded onsets: policies, constant velocity, a sampler of residuals
* `protocols`: the two error protocols, reconstruction and closed loop, batched over interactions
* `roll_out`: the roll-out: policies observe and act, and known kinematics move the agents
* `scene`: kinematics of one vehicle and one pedestrian in torch, for training and evaluation
* `errors`: the columns of Table 9 for any models, by both error protocols, with confidence intervals
* `error_table`: the errors of models as text, with the columns of Table 9
* `roll_out_scores`: scores of roll-outs against recordings: energy score and ADE, each an array over interactions
* `held_out`: the held-out error: both protocols on near misses of clips that training never sees
* `outcomes`: outcomes of simulated episodes under policies, usually without exploration and with a seed not trained on
* `statistics`: confidence intervals and paired comparisons for the whole package
"""
