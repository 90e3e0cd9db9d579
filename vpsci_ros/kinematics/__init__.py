"""Both agents' known kinematics in torch, batched and differentiable, and the roll-out of policies through them.

`scene` moves a free vehicle and a pedestrian, `lane` a vehicle that keeps to its lane; `rollout` lets policies act in
either, for training and for evaluation.
"""
