"""One thread of torch for all that learns, so that a machine with more cores learns the same policy.

Threads that share a sum add it in another order. Its last bits differ then, and after some hundred updates so does the
policy. Networks as small as these gain nothing from a second thread either: they wait for it at every product.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_thread() -> Iterator[None]:
    """Have torch compute in one thread in here, or in a function that this decorates, and then in as many as before."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
