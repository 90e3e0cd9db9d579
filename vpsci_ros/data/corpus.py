"""The near misses of a training: its tables as one, the rows it takes of them, and those held out.

Two interactions of one clip share agents and traffic, so data are split by clips, never by rows or interactions.
"""

import hashlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import polars as pl

from vpsci_ros.data.near_misses import MOTION, clips_of, concat_near_misses, read_near_misses
from vpsci_ros.documents import listed
from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import TO_LEARN_FROM, near_misses_path
from vpsci_ros.safety import CRITICAL_TTC

BEFORE = 10  # steps before the first critical one that learning takes
AFTER = 10  # steps after the last critical one that learning takes
SHARE, SPLIT = 0.2, 1  # of the near misses that is held out where no clips are named, as in the paper; and its seed
NO_CLIPS = "none"  # in place of names: none is held out


def load_corpus(names: Sequence[str | Path]) -> pl.DataFrame:
    """Return the near misses of a training as one table, with consecutive interaction numbers.

    :param names: tables or parts of tables, see `read_near_misses`; none: the training part of the package's right
        turns.
    :raises InvalidInput: a file is missing or does not hold a near-miss table.
    """
    return concat_near_misses([read_near_misses(name) for name in names or [TO_LEARN_FROM]])


def corpus_files(names: Sequence[str | Path]) -> list[Path]:
    """Return the files of the near-miss tables `names`; without a name, the file of the shipped right turns."""
    return [near_misses_path(name) for name in names or [TO_LEARN_FROM]]


def around_critical(table: pl.DataFrame) -> pl.DataFrame:
    """Return each interaction's rows from `BEFORE` steps before its first critical step to `AFTER` after its last one.

    Ten before, because closed loops start at the first critical step after up to ten observed ones, and the policies'
    attention spans ten; ten after, for the motion after the danger. Steps between two critical spells stay, as part of
    one interaction. More steps would fill the buffer with undisturbed motion, and did not help: stage 1 with all 546
    pairs below 10 s of CurvTTC and 30 steps after had the same held-out errors (two folds).
    """
    step = pl.int_range(pl.len()).over("interaction")
    critical = pl.when(pl.col("curvttc") < CRITICAL_TTC).then(step)
    first, last = critical.min().over("interaction"), critical.max().over("interaction")
    return table.filter((step >= first - BEFORE) & (step <= last + AFTER))


def table_hash(table: pl.DataFrame) -> str:
    """Return the SHA-256 of the rows and columns that a training reads, in hexadecimal."""
    table, digest = around_critical(table), hashlib.sha256()
    for name in ("interaction", "source", "clip", *MOTION, "curvttc"):
        digest.update("\0".join(table[name].cast(pl.String)).encode())
    return digest.hexdigest()


def held_out_by(near_misses: pl.DataFrame, names: list[str]) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return near misses to train on, and those held out.

    :param names: of clips to hold out, see `split_by_name`; none: a fifth, by whole clips, the same in every
        training; [`NO_CLIPS`]: none.
    :raises InvalidInput: as `split_by_name` and `split_by_clip`.
    """
    if names == [NO_CLIPS]:
        return near_misses, near_misses.clear()
    return split_by_name(near_misses, names) if names else split_by_clip(near_misses, SHARE, SPLIT)


def split_as_before(near_misses: pl.DataFrame, clips: list[str]) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return near misses to train on, and those of `clips`, "source/clip", that an earlier training held out.

    If the table has none of these clips, a fifth of it is held out, by whole clips.

    :raises InvalidInput: as `split_by_clip`, if that is used.
    """
    held = pl.concat_str("source", "clip", separator="/").is_in(clips)
    held_out = near_misses.filter(held)
    if held_out.is_empty():
        return split_by_clip(near_misses, SHARE, SPLIT)
    return near_misses.filter(~held), held_out


def split_by_clip(table: pl.DataFrame, held_out_fraction: float, seed: int) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Split interactions into (training, held out), whole clips at a time and each source in the same proportion.

    Clips are taken in the order of a hash of (seed, source, clip), so that a clip's place does not depend on which
    others there are; one that would overshoot the fraction of interactions is passed over. A source of a single
    clip stays in training.

    :param held_out_fraction: of the interactions, above 0 and below 1; the held-out share of a source is at most this,
        unless no clip is so small: then the smallest clip is held out.
    :raises InvalidInput: a fraction out of range, or no source with two clips.
    """
    if not 0.0 < held_out_fraction < 1.0:
        raise InvalidInput(f"held_out_fraction = {held_out_fraction}: expected above 0 and below 1")
    counts = table.group_by("source", "clip").agg(pl.col("interaction").n_unique().alias("n")).rows()
    held: list[tuple[str, str]] = []
    for source in sorted({source for source, _, _ in counts}):
        clips = sorted((place_of(seed, source, clip), clip, n) for name, clip, n in counts if name == source)
        if len(clips) < 2:
            continue
        room = held_out_fraction * sum(n for _, _, n in clips)
        taken = []
        for _, clip, n in clips:
            if n <= room:
                taken.append(clip)
                room -= n
        held += [(source, clip) for clip in taken or [min(clips, key=lambda c: (c[2], c[0]))[1]]]
    if not held:
        raise InvalidInput(
            "expected two clips or more of a source, since whole clips are held out; got "
            f"{', '.join(clips_of(table))}; add recordings, or cut yours into clips (`clip` in a layout)"
        )
    return split_off(table, held)


def split_by_name(
    table: pl.DataFrame, clips: Sequence[str], option: str = "held_out_clips ="
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Split interactions into (training, held out); held out are clips whose "source/clip" begins with one of `clips`.

    :param option: by which the clips are named, the opening of an error message.
    :raises InvalidInput: no clip begins with one of the names, or every clip is held out.
    """
    own = [(str(source), str(clip)) for source, clip in table.select("source", "clip").unique().rows()]
    names = sorted(map("/".join, own))
    for name in clips:
        if not any(each.startswith(name) for each in names):
            raise InvalidInput(f"{option} {name}: no clip begins so; the near misses have {_folders(names)}")
    held = [(source, clip) for source, clip in own if f"{source}/{clip}".startswith(tuple(clips))]
    if len(held) == len(own):
        raise InvalidInput(f"{option} {listed(clips)}: all {len(own)} clips begin so; leave some to learn from")
    return split_off(table, held)


def _folders(names: Sequence[str], most: int = 8) -> str:
    """Return the names of at most `most` clips; of more clips the folders in their names, with numbers of clips."""
    if len(names) <= most:
        return listed(names)
    parts = [name.split("/")[:-1] for name in names]
    depths = range(1, 1 + max(map(len, parts)))
    counts = [Counter("/".join(part[:depth]) + "/" for part in parts) for depth in depths]
    deepest = max((count for count in counts if len(count) <= most), key=len, default=counts[0])
    return f"{listed((f'{name} ({n} clips)' for name, n in sorted(deepest.items())), most)}, such as {names[0]}"


def split_off(table: pl.DataFrame, held: list[tuple[str, str]]) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Split interactions into (training, held out); `held` names the held-out clips, (source, clip) each."""
    keys, on = pl.DataFrame(held, schema={"source": pl.String, "clip": pl.String}, orient="row"), ["source", "clip"]
    rest = table.join(keys, on=on, how="anti", maintain_order="left")
    return rest, table.join(keys, on=on, how="semi", maintain_order="left")


def place_of(seed: int, source: str, clip: str) -> str:
    """Return the hash of a clip by which `split_by_clip` sorts clips."""
    return hashlib.sha256(f"{seed}/{source}/{clip}".encode()).hexdigest()
