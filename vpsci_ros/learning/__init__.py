"""Learning: MA-SST-DDPG from real near misses (stage 1) and in simulation (stage 2).

`pretrain` is stage 1, `refine` is stage 2, and `online` runs stage 2 in one process. Both update `networks` by one of
the `objectives` (the paper's: `maddpg`), with batches of `replay` and the `rewards` of their stage; `transitions` and
`assembly` make the histories of stage 2. The actors are in `policy`, recorded near misses as arrays in
`data.interactions`.
"""
