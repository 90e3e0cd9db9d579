import dataclasses

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.models import make_actor


def test_an_encoder_that_nobody_knows_is_refused():
    with pytest.raises(InvalidInput, match="unknown network 'gpt'"):
        make_actor(dataclasses.replace(NetworkConfig(), encoder="gpt"))
