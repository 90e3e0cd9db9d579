"""The policies: the default agents `people`, networks, and how either acts in an episode. Training is in `learning`.

In reading order:

* `people_agent`: the agents `people`: from a world state to an action by a bank's reactions
* `bank`: a bank of recorded reactions: the actions of both agents after many recorded situations
* `choice`: the choice of a recorded reaction for an agent, by a roll-out of each candidate
* `reaction`: a chosen reaction: actions at each step, a roll-out of its rest, and the least evasion
* `forecast`: what both agents do on average in the 3 s after a situation, by a small network
* `onset_range`: the range of recorded onsets of a source: speeds, distances, walking speeds and angles
* `make_bank`: make a bank of recorded reactions from near misses
* `policy_file`: the file of a policy: a bank of recorded reactions or weights of networks
* `agent`: the policy of one agent, from a world state to an action, used by the loop in one process and by a node
* `agent_types`: the kinds of agents: the policy by a bank or weights
* `policy_config`: parameters of policies: the shape of their networks, and their exploration
* `simulation_config`: a simulation as one value: its episodes, its world, and the policies' exploration
* `histories`: bookkeeping of histories: one for each time that the policies take control (Algorithm 1)
* `draws`: keys of the policies' random numbers: pure functions of seed, scenario, episode, pedestrian and frame
* `exploration`: exploration noise (16), a pure function of (seed, scenario, episode, step, agent)
* `sst`: the state-space Transformer of equations (3) and (4): a structured recurrence
* `actor`: the actor: an encoder of the history and two hidden layers on top, to two accelerations (Table 8)
* `streaming`: streaming inference: one new step for many parallel histories at O(1) cost, with stored state
* `streaming_kernels`: one streamed step of an SST actor in numba
* `models`: the networks by name, for `learner.encoder` and `vpsci study models`
* `stepped`: inference of networks other than the SST: torch computes the whole history at each step
* `weights`: weights of all networks in one safetensors file
* `shapes`: names and shapes of the tensors of a network configuration; for the SST, torch is not needed
* `tensor_file`: tensors and metadata in one safetensors file, with deterministic bytes and a checksum
* `compiling`: compilation of the kernels of a default run in parallel processes, once for each state of the sources
"""
