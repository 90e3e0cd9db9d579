"""Damage done to a file on purpose: what disks, hands and other people's programs do to one, from a seed."""

import random
import re
from collections.abc import Callable

ODD = [
    "", "nan", "inf", "-inf", "-1", "0", "1e308", "-1e308", "1e-308", "9" * 30, "-" + "9" * 400, "18446744073709551616",
    "0x7f", "1_0", "true", "null", "~", "[]", "{}", "[[[]]]", "'", '"', "\x00", "\u202e", "é", "0.1.2", "2001-13-45",
    "12:61:61", "!!python/object:os.system", "!!int", "&a [*a]", "*a", "? [1, 2]", "-", ":", "a: b: c", "\t", "%",
]  # fmt: skip
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9.]*")


def mutated(data: bytes, rng: random.Random, *, text: bool) -> bytes:
    """Return the content of a file with one to three damages; `text`: also such as only text can have."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = rng.choice(OF_TEXT if text else OF_BYTES)(data, rng)
    return data


def _flip(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    if out:
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _near_the_end(data: bytes, rng: random.Random) -> bytes:
    return data[: max(0, len(data) - rng.randrange(1, 200))]


def _overwrite(data: bytes, rng: random.Random) -> bytes:
    at, length = rng.randrange(len(data) + 1), rng.choice((1, 4, 8, 64))
    return data[:at] + rng.choice((rng.randbytes(length), b"\xff" * length, bytes(length))) + data[at + length :]


def _drop(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[at + rng.choice((1, 8, 100, 1000)) :]


def _again(data: bytes, rng: random.Random) -> bytes:
    at, length = rng.randrange(len(data) + 1), rng.choice((1, 16, 500))
    return data[: at + length] + data[at : at + length] * rng.choice((1, 3)) + data[at + length :]


def _lines(data: bytes, rng: random.Random) -> bytes:
    """Drop, repeat or exchange lines."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(3)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return b"".join(lines)


def _at(pattern: re.Pattern[bytes]) -> Callable[[bytes, random.Random], bytes]:
    def replace(data: bytes, rng: random.Random) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return data
        match = rng.choice(found)
        return data[: match.start()] + rng.choice(ODD).encode() + data[match.end() :]

    return replace


OF_BYTES = (_flip, _flip, _cut, _near_the_end, _overwrite, _drop, _again)
OF_TEXT = (*OF_BYTES, *(_at(NUMBER),) * 5, *(_at(WORD),) * 3, _lines, _lines)
