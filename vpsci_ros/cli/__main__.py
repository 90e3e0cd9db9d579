"""`python -m vpsci_ros.cli` is `vpsci`."""

from vpsci_ros.cli.main import main

main()
