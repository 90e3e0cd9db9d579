"""Behaviour cloning in stage 1; the critics' policy gradient in stage 2, as in the paper."""

from dataclasses import replace

import torch

from vpsci_ros.learning.objectives import Objective, find_objective


class Cloning:
    """The actors learn the recorded acceleration of each step."""

    def __init__(self, training, config):
        self.training = training
        actors = training.maddpg.networks.actor
        self.optimisers = [torch.optim.Adam(actors.parameters(), lr=1e-3)]  # a checkpoint stores their state

    def update(self, batch, iteration, rng):
        """Update actors, critics and targets once; draw random numbers only from `rng` or torch's generator."""
        actions = self.training.maddpg.act(batch)  # agent -> float32[M, T, 2] [m/s2], with gradient
        errors = torch.stack([(done - batch.action[agent]).square().sum(dim=2) for agent, done in actions.items()])
        loss = (errors * batch.present).sum() / batch.present.sum()  # histories are padded to the longest one
        self.optimisers[0].zero_grad()
        loss.backward()
        self.optimisers[0].step()
        result = self.training.update_critics(batch, rng)
        return replace(result, more={"cloning_error": float(loss.detach())})


CLONING = Objective(pretrain=Cloning, refine=find_objective("ddpg").refine)
