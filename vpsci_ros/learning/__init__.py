"""Learning: the paper's networks from real near misses (stage 1) and in simulation (stage 2).

The actors are in `policy`, recorded near misses as arrays in `data.interactions`.

In reading order:

* `pretrain`: stage 1: both agents learn from recorded near misses (Algorithm 1), by one of the `objectives`
* `refine`: stage 2: the pre-trained policies are trained further in simulation (section 3.2)
* `closed_loop`: both actors rolled out in closed loop through the kinematics, with gradients
* `forecast`: a forecast for a bank, learned by five trainings of stage 1 from near misses
* `online`: stage 2 in one process: world, monitor, policies and learner called in turn
* `objectives`: one update of each stage in the order of its events, by the objectives `ddpg` and `closed_loop`
* `rewards`: all rewards of the paper: speed (14)-(15), collision (25), goal (26) and their weighting (27)-(28)
* `networks`: all networks of MA-SST-DDPG: an actor and a critic for each agent, and a target network of each
* `replay`: the replay buffers of both stages, and mini-batches drawn from a buffer
* `transitions`: experience for the learner: one record per policy step, made from successive states of a world
* `assembly`: assembly of transitions from `/replay` into histories, from the first hand-over to the episode's end
* `ragged`: histories of different length in one padded batch, encoded without most of the padding
* `training_config`: parameters of training, in groups; the defaults are those of the shipped weights `closed_loop`
* `refine_log`: the logs of stage 2 in the graph of nodes, written during the training, whole or not at all
* `checkpoint`: checkpoints: the state from which a run resumes with the same result, in one safetensors file
* `divergence`: a check that losses and reward weights are finite; otherwise the run stops
* `adam`: the optimiser Adam of torch, without the import of torch's compiler
* `one_thread`: one thread of torch for training, so that the result does not depend on the number of cores
"""
