"""Fixtures of nodes, for a graph whose world is in a server."""

from nodes.conftest import closed, context, domain, weights  # noqa: F401 (fixtures)
