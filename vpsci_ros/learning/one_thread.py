"""One thread of torch for training, so that the result does not depend on the number of cores.

Threads that share a sum add it in another order. Its last bits differ then, and after some hundred updates so does the
policy. Networks as small as these gain nothing from a second thread either: they wait for it at every product.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_thread() -> Iterator[None]:
    """Context manager and decorator: torch computes in one thread inside, and afterwards in as many as before."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
