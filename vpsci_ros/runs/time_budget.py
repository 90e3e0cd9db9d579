"""How long reading may take: so much processor time, that what is made to harm who reads it takes no longer."""

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from vpsci_ros.errors import InvalidInput

T = TypeVar("T")
LEAST = 20.0  # [s]
PER_BYTE = 2e-6  # [s] more for each byte of a file; whole bags take a thirtieth of that


class TimeBudget:
    """The processor time that reading something may take; what is read is used outside of it.

    :param what: is read, the opening of the error message.
    :param seconds: of this thread's processor time, which does not depend on what else the machine does.
    """

    def __init__(self, what: str, seconds: float) -> None:
        self._what, self._limit = what, seconds
        self._spent = 0.0
        self._begun: float | None = None

    @classmethod
    def of_file(cls, path: Path) -> "TimeBudget":
        """Return that of one file, by its size."""
        return cls(f"{path}: reading it", LEAST + PER_BYTE * path.stat().st_size)

    @property
    def exceeded(self) -> bool:
        """Whether it is used up."""
        running = 0.0 if self._begun is None else time.thread_time() - self._begun
        return self._spent + running > self._limit

    def require(self) -> None:
        """Refuse to read on.

        :raises InvalidInput: the budget is used up.
        """
        if self.exceeded:
            raise InvalidInput(
                f"{self._what} takes more than {self._limit:.0f} s of processor time, out of all proportion to its "
                "size; is it made to harm who reads it?"
            )

    def spent_on(self, items: Iterable[T]) -> Iterator[T]:
        """Yield the items of a reader.

        :raises InvalidInput: the budget is used up.
        """
        source = iter(items)
        while True:
            self._begun = time.thread_time()
            try:
                item = next(source)
            except StopIteration:
                return
            finally:
                self._spent, self._begun = self._spent + time.thread_time() - self._begun, None
            self.require()
            yield item
