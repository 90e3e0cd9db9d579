"""A time limit for a stranger's code that runs in this process."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

_AGAIN = 1.0  # [s] after which code that swallows the exception gets it once more


class NoAnswer(BaseException):
    """The time is over; no `Exception`, so that code which catches those does not swallow it."""


@contextlib.contextmanager
def within(seconds: float) -> Iterator[None]:
    """Interrupt what runs in the `with` block after so long, by the wall clock; 0: never.

    Python code is interrupted wherever it is, compiled code when it returns to Python. Only the main thread can be:
    in another one there is no limit.

    :raises NoAnswer: the time is over.
    """

    def over(_: int, __: FrameType | None) -> None:
        raise NoAnswer(f"no answer for {seconds:g} s")

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, seconds, _AGAIN)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
