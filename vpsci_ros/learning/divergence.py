"""A check that losses and reward weights are finite; otherwise the run stops."""

import math
from collections.abc import Mapping

from vpsci_ros.errors import VpsciError


class DivergedError(VpsciError):
    """A loss, or a value computed from losses, is not finite."""


def require_finite(values: Mapping[str, float], where: str) -> None:
    """Raise `DivergedError` unless all values are finite.

    :param values: numbers by name, both for the message; where: such as "update 7", the opening of the message.
    :raises DivergedError: a value is not finite.
    """
    bad = ", ".join(f"{name} = {value}" for name, value in values.items() if not math.isfinite(value))
    if bad:
        raise DivergedError(
            f"{where}: expected finite values, got {bad}; lower the learning rates, or look for outliers in the data"
        )
