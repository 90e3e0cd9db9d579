"""How large the datasets of these tests are."""

from vpsci_ros.policy.policy_config import NetworkConfig

NETWORK = NetworkConfig(hidden=16, heads=2)
TARGETS = {1: 12, 6: 12}
UNIT, PARALLEL = 8, 40
