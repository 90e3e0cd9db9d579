"""The average of several trainings, which does better than each where all began from the same weights.

See 'Model soups: averaging weights of multiple fine-tuned models improves accuracy without increasing inference time'
by Wortsman et al., ICML 2022 (https://arxiv.org/abs/2203.05482).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.weights import Tensors, Weights


def average(several: Sequence[Weights]) -> Weights:
    """Return weights whose tensors are the means of those of `several`, which are trainings of the same stage.

    What all of them say of themselves (configuration and facts) it says, too; what differs stands in the fact
    `averaged`, in the order given, each with the digest of its tensors.

    :raises InvalidInput: fewer than two, or they differ in network, stage, or what they learned from and held out.
    """
    if len(several) < 2:
        raise InvalidInput(f"weights to average: expected two or more, got {len(several)}")
    first = several[0]
    for number, other in enumerate(several[1:], start=2):
        for name, one, own in [("network", first.network, other.network)] + [
            (name, first.facts.get(name), other.facts.get(name)) for name in ("stage", "data")
        ]:
            if one != own:
                raise InvalidInput(
                    f"weights to average: {name} of number {number}: expected {one}, as of the first, got {own}"
                )
    tensors: Tensors = {}
    for name in first.tensors:
        tensors[name] = (
            np.stack([own.tensors[name] for own in several]).mean(axis=0, dtype=np.float64).astype(np.float32)
        )
    facts, configuration = _common([own.facts for own in several]), _common([own.configuration for own in several])
    parts = [
        {"tensors_sha256": own.digest()}
        | {name: value for name, value in own.facts.items() if name not in facts}
        | {"configuration": {name: value for name, value in own.configuration.items() if name not in configuration}}
        for own in several
    ]
    return Weights(first.network, tensors, configuration, facts | {"averaged": parts})


def _common(several: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {name: value for name, value in several[0].items() if all(own.get(name) == value for own in several[1:])}
