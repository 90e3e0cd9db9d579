"""Learning: MA-SST-DDPG from real near misses (stage 1) and in simulation (stage 2), and its policies at work.

`sst` is the state-space Transformer, `actor` and `critic` the networks on top of it, `networks` all eight of them.
`weights` keeps them in one safetensors file; `streaming` runs an actor step by step without torch, and `agent` puts it
to work in an episode. `interactions` holds recorded near misses as arrays, `scene` the known kinematics, `protocols`
the two honest measures of error. `pretrain` is stage 1, with the updates of `maddpg` and `imitation`; `refine` is
stage 2, with `transitions`, `replay`, `rewards` and `exploration`.

Only the modules that train import torch, so a policy node starts without it.
"""
