"""Learning: MA-SST-DDPG from real near misses (stage 1) and in simulation (stage 2).

`pretrain` is stage 1, with the updates of `maddpg` and `imitation`; `refine` is stage 2, with `transitions`, `replay`,
`rewards` and `foresight`, and `online` runs it in one process. `critic` and `networks` are what only training needs;
the actors are in `policy`, recorded near misses as arrays in `data.interactions`.
"""
