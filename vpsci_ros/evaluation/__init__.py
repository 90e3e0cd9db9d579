"""Models measured against recordings: two protocols of error, naive controls, and yielding.

`predictors` puts models and controls under one interface, `protocols` rolls them out through the known kinematics
(`scene`, in torch),
`errors` summarises with intervals, `held_out` measures a training on held-out clips.
"""
