"""A keyed hash, by a secret of the run, distinguishes what a graph's own nodes sent from what other programs did.

ROS 2 does not say who sent a message, unless DDS security is on. The graph makes a secret for each run and gives it to
its processes by their environment, which no other user and no node can read; parameters are no place for it, since
any program may request them from a node. A node that was started by hand has no secret, and accepts what it gets.
"""

import hashlib
import hmac
import os
import secrets

from vpsci_ros.errors import InvalidInput

VARIABLE = "VPSCI_RUN_SECRET"


def new_secret() -> str:
    """Return a secret for a run, 64 hexadecimal digits."""
    return secrets.token_hex(32)


def is_signed() -> bool:
    """Return whether this process is of a run with a secret, so that its messages are signed."""
    return bool(os.environ.get(VARIABLE))


def signature(version: int, data: bytes) -> str:
    """Return the HMAC-SHA256 (RFC 2104) of a version and its bytes, as hexadecimal digits; empty without a secret."""
    secret = os.environ.get(VARIABLE, "")
    return hmac.new(secret.encode(), b"%d " % version + data, hashlib.sha256).hexdigest() if secret else ""


def require_signature(given: str, version: int, data: bytes, where: str) -> None:
    """Refuse what no process of this run has signed; without a secret nothing is refused.

    :param where: the topic, which opens the message.
    :raises InvalidInput: the signature is another one, or none.
    """
    if not hmac.compare_digest(given.encode(), signature(version, data).encode()) and is_signed():
        raise InvalidInput(
            f"{where}: no node of this run has signed this ({version}); does another program publish in this domain?"
        )
