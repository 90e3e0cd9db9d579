"""Lock-step of the world with other processes: answers to ticks, drivers from outside, and counters.

`lock_step` collects the answers to a tick, and says when the world may go on. `external_driver` takes the commands of a
driver from outside, in lock-step or in real time with a safe stop. `intervention` changes these commands in chosen
episodes. `engines` finds the engine that moves the agents in place of this package's kinematics. `counts` has what went
wrong and right, `simulator_config` the parameters.
"""
