"""The package's one exception base: every message says what was expected, what came, where, and what to do."""


class VpsciError(Exception):
    """Base of every error that this package raises on purpose; the command line prints it without a traceback."""


class InvalidInput(VpsciError, ValueError):
    """Data, a parameter or a file is not as it has to be (also a `ValueError`)."""


class Stopped(Exception):
    """Raised by a `report` callback to stop a run, which then writes a checkpoint to go on from; no error."""
