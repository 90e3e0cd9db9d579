"""`python -m vpsci_ros.nodes NODE --ros-args ...` runs one node, NODE,NODE,... several in one process."""

import sys

from vpsci_ros.nodes.entry import start

sys.exit(start(sys.argv[1], sys.argv[1:]))
