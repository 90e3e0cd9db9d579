"""Kinematics of both agents in torch, batched and differentiable, and roll-outs of policies through them.

`scene` moves a free vehicle and a pedestrian, `lane` a vehicle that keeps to its lane; `rollout` lets policies act in
either, for training and for evaluation.
"""
