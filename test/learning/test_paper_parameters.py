"""The policies of stage 2 explore by the paper's numbers; test_shipped_ma_sst_ddpg.py asks for all other parameters."""

import numpy as np
import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.policy.exploration import amplitude
from vpsci_ros.policy.policy_config import NetworkConfig, PolicyConfig
from vpsci_ros.resources import params_dir
from vpsci_ros.world.observation import AGENTS


@pytest.mark.parametrize("agent", AGENTS)
def test_the_papers_policies_explore_by_the_numbers_of_equation_16(agent):
    """exp(-0.001 t) + 0.05 m/s2, t the training episode; number 125 in each of eight scenarios is the 1,000th.

    The paper has N_0 = 0.3 and no unit; as 0.3 m/s2 it moves nobody far enough to meet danger early.
    """
    config = load(params_dir() / "stage2_online.yaml").get(PolicyConfig, f"{agent}_policy")
    limit = NetworkConfig().action_limit
    assert limit * amplitude([0, 125], config.noise) == pytest.approx([1.05, np.exp(-1.0) + 0.05])
    assert config.explore
