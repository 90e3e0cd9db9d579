"""Errors of models against recordings, by two protocols, beside naive controls.

`predictors` puts models and controls under one interface, `protocols` rolls them out (`roll_out`) through the known
kinematics (`scene`, in torch), `errors` summarises with intervals, `held_out` measures a training on held-out clips.
"""
