"""Models measured against recordings: two honest protocols for error, naive controls, and who yielded.

`predictors` puts models and controls under one interface, `protocols` rolls them out through the known kinematics,
`errors` sums up with intervals, `held_out` measures a training on clips that it never sees. `measure_series` and
`safety_compare` are about the safety measures, `encounters` and `yields` about what came of an interaction.
"""
