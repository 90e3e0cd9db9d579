"""A damaged bag is never taken for a whole one: whatever byte has changed, `bag info` says so or gives an error."""

import contextlib
import random
import shutil
from pathlib import Path

from mcap.reader import make_reader

from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.repair import repair_bag
from vpsci_ros.errors import InvalidInput


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return the bytes with a flipped bit anywhere, near the beginning or near the end, or with eight bytes changed."""
    out = bytearray(data)
    place, kind = rng.randrange(len(out)), rng.randrange(4)
    if kind == 1:
        place = rng.randrange(min(6000, len(out)))
    elif kind == 2:
        place = len(out) - 1 - rng.randrange(min(4000, len(out)))
    elif kind == 3:
        out[place : place + 8] = rng.randbytes(len(out[place : place + 8]))
        return bytes(out)
    out[place] ^= 1 << rng.randrange(8)
    return bytes(out)


def test_a_changed_byte_is_always_noticed_and_never_ends_in_a_traceback(short_bag: Path, tmp_path: Path) -> None:
    bag = shutil.copytree(short_bag, tmp_path / "bag")
    (path,) = bag.glob("*.mcap")
    data, rng = path.read_bytes(), random.Random(0)
    read = 0
    for _ in range(40):
        path.write_bytes(damaged(data, rng))
        with contextlib.suppress(InvalidInput):
            assert bag_info(bag)["damage"], "taken for a whole bag"
            read += 1
    assert read > 0, "nothing of any of them was read"


def test_of_a_bag_of_one_episode_a_damaged_byte_costs_one_chunk_and_repair_keeps_the_rest(
    own_bag: Path, tmp_path: Path
) -> None:
    bag = shutil.copytree(own_bag, tmp_path / "bag")
    (path,) = bag.glob("*.mcap")
    messages = bag_info(bag)["messages"]
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[1]
    data = bytearray(path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    path.write_bytes(data)
    kept = sum(repair_bag(bag).messages.values())
    assert messages > kept > 0.8 * messages
    assert bag_info(bag)["damage"] == []
