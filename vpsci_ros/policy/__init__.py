"""The policies: networks, weights, streaming inference, and acting agents. Training is in `learning`.

`sst` is the state-space Transformer and `actor` the network on top of it, for training; `streaming` runs the same actor
step by step without torch, and `agent` puts it to work in an episode. `weights` keeps all networks in one safetensors
file, whose tensors `shapes` knows. A policy node starts without torch. `models` names the other
networks that may act, with other layers in place of the SST's; `stepped` runs them step by step.
"""
