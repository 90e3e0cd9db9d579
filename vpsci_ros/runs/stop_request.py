"""A stop request set by signals: a plain flag, since handlers may interrupt each other.

Python runs a signal's handler between any two instructions of the main thread, another handler's among them. What takes
a lock there, as `threading.Event.set` does, waits for ever for itself where a second signal comes in between. To set a
flag is one instruction and takes no lock; the loop that waits looks at it again and again.
"""

import contextlib
import signal
import threading
from collections.abc import Iterator

from vpsci_ros.errors import Stopped

REQUESTS = (signal.SIGINT, signal.SIGTERM)


class StopRequest:
    """A stop request; it cannot be withdrawn."""

    def __init__(self) -> None:
        self._made = False
        self._at_once = False

    def set(self, *_: object) -> None:
        """Request a stop; safe to call from a signal handler, repeatedly.

        :raises Stopped: in a block of `at_once`, the first time.
        """
        self._made = True
        if self._at_once:
            self._at_once = False
            raise Stopped

    def is_set(self) -> bool:
        """Return whether a stop was requested."""
        return self._made

    def check(self) -> None:
        """Raise `Stopped` if a stop was requested.

        :raises Stopped: it was.
        """
        if self._made:
            raise Stopped

    @contextlib.contextmanager
    def at_once(self) -> Iterator[None]:
        """Context manager in which a request stops the block at once, for work without intermediate results.

        :raises Stopped: one was made before or comes now.
        """
        self.check()
        self._at_once = True
        try:
            yield
        finally:
            self._at_once = False


@contextlib.contextmanager
def stop_requested_by_signals(*, to_the_end: bool = False) -> Iterator[StopRequest]:
    """Yield a stop request that SIGINT and SIGTERM set, instead of their usual handlers.

    In another thread than the main one, to which signals do not go, nobody makes it.

    :param to_the_end: the process ends after the block; SIGINT and SIGTERM are ignored from then on.
    """
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return
    before = {number: signal.signal(number, request.set) for number in REQUESTS}
    signal.pthread_sigmask(signal.SIG_UNBLOCK, REQUESTS)  # of one that came before, see `ChildProcess`
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if to_the_end else handler)


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Context manager that defers SIGINT and SIGTERM, for short work that must not be interrupted.

    By handlers, since a mask is each thread's own, and libraries start threads.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    made: list[int] = []
    before = {number: signal.signal(number, lambda number, _: made.append(number)) for number in REQUESTS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if made:
            signal.raise_signal(made[0])
