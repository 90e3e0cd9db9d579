"""The file of a policy: a bank of recorded reactions or weights of networks, distinguished by its metadata."""

from pathlib import Path
from typing import TypeAlias

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy import bank
from vpsci_ros.policy.bank import Bank, bank_from_bytes
from vpsci_ros.policy.tensor_file import format_of, read_bytes
from vpsci_ros.policy.weights import Weights, weights_from_bytes
from vpsci_ros.resources import weights_path

Policy: TypeAlias = Bank | Weights
SHIPPED = ("people", "closed_loop", "ma_sst_ddpg")


def policy_from_bytes(data: bytes, where: str = "policy") -> Policy:
    """Return the policy in the bytes of its file; `where` opens the error messages.

    :raises InvalidInput: neither a bank nor weights, or a damaged file.
    """
    form = format_of(data, where)
    return bank_from_bytes(data, where) if form.startswith(bank.FAMILY) else weights_from_bytes(data, where)


def load_policy(name: str | Path) -> Policy:
    """Read a policy: a file, or one shipped with the package by its name, `people`, `closed_loop` or `ma_sst_ddpg`.

    :raises InvalidInput: no such file, or as `policy_from_bytes`.
    """
    path = weights_path(str(name))
    return policy_from_bytes(
        read_bytes(path, "the policy: make one with `vpsci people`, or name a shipped one"), str(path)
    )


def require_source(policy: Policy, people: str) -> None:
    """Refuse the name of a source whose reactions a policy does not have; an empty name is accepted.

    :raises InvalidInput: a bank without that source, or networks.
    """
    if isinstance(policy, Bank):
        policy.of(people)
    elif people:
        raise InvalidInput(f"people: expected a bank for {people!r}, got weights of networks; leave it empty")


def named_policies(given: list[str]) -> dict[str, Path]:
    """Return name -> file of policies given as NAME=FILE, or as a file or shipped name alone.

    :raises InvalidInput: a name is given twice, or there is no such file.
    """
    out: dict[str, Path] = {}
    for text in given:
        name, equals, path = text.rpartition("=")
        name = name if equals else Path(path).stem
        if name in out:
            raise InvalidInput(f"--weights {text}: {name} is there twice; name them, NAME=FILE")
        out[name] = weights_path(path)
    return out
