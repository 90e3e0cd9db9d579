"""Importers, clips and tracks: read from CSV with every value checked, cut at gaps, and resampled to the 0.1 s grid.

`import_recordings` lists the importers; other installed packages add theirs (docs/extending.md).
"""

import codecs
import itertools
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.near_misses import CYCLIST, WALKER
from vpsci_ros.documents import foreign, listed, reason, require_regular, shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
ROLES = ("vehicles", "pedestrians")
MAX_GAP = 0.25  # [s] rows further apart than this are not bridged: the track is cut there
SPARSEST = 0.5  # [s] from one row of a road user to the next, 2 Hz; recordings of fewer rows are refused
GAPS = "gaps between rows, at which tracks are cut"  # a count of `Clip.left_out`
LONGEST_LINE = 2**16  # [bytes] of the first line, with the columns' names: a hundred thousand columns take gigabytes
LARGEST = 2.0**53  # above it a float64 does not hold every whole number
WHOLE = r"^([+-]?\d+)\.0*$"  # a whole number as pandas writes it where values are missing
BACKWARDS = "frames of vehicles that drive backwards"  # a count of `Clip.left_out`
NO_HEADING = "vehicles without a heading that never drive 0.5 m"  # a count of `SourceSummary.left_out`
LINE = "line in the file"  # a column with the number of each row's line, for error messages
FAST = 2.5  # [m/s] a pedestrian whose median speed exceeds it may ride a bicycle
_WALKS = 0.5  # [m/s] above it a pedestrian moves
_SLACK = 0.05  # by which times may differ from the rate
_BRIDGED = 1.5  # spacings of rows; a track is cut where one row or more is missing
_GRID = 1e-6  # [steps] a frame this near to a grid point counts as on it


@dataclass(frozen=True)
class Track:
    """One agent's unbroken piece of a clip on the grid t = 0.1 s * k.

    :ivar first: k of the first value.
    :ivar values: column name -> float64[T], one value a grid step.
    :ivar size: length and width [m] of a vehicle, where its recording says; None: see `Importer`.
    :ivar name: the id in the recording; "": its number.
    :ivar kind: of a pedestrian, of `KINDS`; "": its median speed says it, see `Clip.of_kinds`.
    """

    number: int
    first: int
    values: dict[str, Floats]
    size: tuple[float, float] | None = None
    name: str = ""
    kind: str = WALKER

    @property
    def last(self) -> int:
        """The step k on the grid of the track's last value."""
        return self.first + len(next(iter(self.values.values()))) - 1


@dataclass(frozen=True)
class LeftOut:
    """How many road users a check left out, of how many that it judged, in how many of how many clips, and the first.

    :ivar judged: 0: whole clips were left out, or, without an example, by a rule that is no reason to refuse.
    """

    count: int = 0
    judged: int = 0
    example: str = ""
    odd_clips: int = 0
    clips: int = 0


class Checks(dict[str, LeftOut]):
    """What checks left out, by a text that says whom."""

    def report(self, what: str, judged: int, odd: Collection[int], text: str) -> Collection[int]:
        """Count the road users `odd` of `judged` that a check leaves out, and why, in words; return their numbers."""
        if judged:
            self.add({what: LeftOut(len(odd), judged, text if odd else "")})
        return odd

    def add(self, more: Mapping[str, LeftOut]) -> None:
        """Add further counts."""
        for what, own in more.items():
            old = self.get(what, LeftOut())
            sums = {name: getattr(old, name) + getattr(own, name) for name in ("count", "judged", "odd_clips", "clips")}
            self[what] = LeftOut(**sums, example=old.example or own.example)


@dataclass(frozen=True)
class Clip:
    """One recording: tracks on the 0.1 s grid under the near-miss table's names, without their `veh_` and `ped_`.

    Vehicles have x, y, heading, speed, pedestrians x, y, vx, vy (float64[T]), right-handed, in metres, m/s and radians
    counter-clockwise from x. The heading of a vehicle is NaN where it is unknown.

    :ivar left_out: counts of rows and frames that were left out, by a text that says what they are.
    :ivar road_users: likewise, of road users.
    :ivar assumed: a text for each fact that the recording does not hold.
    :ivar source: the name that the recordings give their source, and `size` length and width [m] of vehicles whose
        tracks have no size; all clips of a folder have the same. "" and None: those of the format.
    :ivar fixed: positions are in a frame fixed to the ground, even if most pedestrians move alike.
    :ivar described: it was read by a user's `layout.yaml`, whose keys messages may name.
    """

    name: str
    vehicles: list[Track]
    pedestrians: list[Track]
    left_out: Mapping[str, int] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    source: str = ""
    size: tuple[float, float] | None = None
    fixed: bool = False
    road_users: Mapping[str, LeftOut] = field(default_factory=dict)
    described: bool = False

    @property
    def usable(self) -> bool:
        """Whether the clip could be read, see `unusable`."""
        return not any(own.example and not own.judged for own in self.road_users.values())

    def users(self) -> int:
        """Return the number of vehicles and pedestrians, each counted once."""
        return sum(len({track.number for track in tracks}) for tracks in (self.vehicles, self.pedestrians))

    def with_headings(self) -> "Clip":
        """Return the clip without vehicles whose heading is NaN; `left_out` counts them."""
        known = [track for track in self.vehicles if not np.isnan(track.values["heading"]).any()]
        count = {NO_HEADING: len(self.vehicles) - len(known)}
        return replace(self, vehicles=known, left_out=Counter(self.left_out) + Counter(count))

    def of_kinds(self, kinds: Collection[str], fastest: float) -> "Clip":
        """Return the clip with pedestrians of these kinds alone, whose median speed is at most `fastest` [m/s].

        Where the recording does not say the kind, somebody with a median speed above `FAST` is a cyclist.
        `road_users` counts other kinds, `left_out` the faster tracks.
        """
        every: dict[int, list[Track]] = {}
        for track in self.pedestrians:
            every.setdefault(track.number, []).append(track)
        kind = {number: own[0].kind or (WALKER, CYCLIST)[median_speed(*own) > FAST] for number, own in every.items()}
        others, checks = Counter(own for own in kind.values() if own not in kinds), Checks(self.road_users)
        checks.add({f"{own}s, which `--kinds {own}` imports": LeftOut(n) for own, n in sorted(others.items())})
        tracks = [replace(track, kind=kind[track.number]) for track in self.pedestrians if kind[track.number] in kinds]
        slow = [track for track in tracks if median_speed(track) <= fastest]
        left_out = Counter(self.left_out) + Counter(
            {f"pedestrians faster than {fastest:g} m/s": len(tracks) - len(slow)}
        )
        return replace(self, pedestrians=slow, road_users=checks, left_out=left_out)


class Unusable(InvalidInput):
    """A clip of which nothing can be used: `what` such clips are, as a summary counts them, and the message."""

    def __init__(self, what: str, message: str) -> None:
        super().__init__(message)
        self.what = what


def unusable(name: str, error: InvalidInput) -> Clip:
    """Return an empty clip that says why nothing of it can be used."""
    what = error.what if isinstance(error, Unusable) else "clips that cannot be read"
    return Clip(name, [], [], road_users={what: LeftOut(1, 0, str(error))})


def attempted(name: str, read: Callable[[], Clip]) -> Clip:
    """Return the clip that `read` returns, or one that is `unusable`."""
    try:
        return read()
    except InvalidInput as error:
        return unusable(name, error)


def merged(parts: Sequence[Clip]) -> Clip:
    """Return clips of one recording as one: the tracks of all, with summed counts.

    Pedestrians of two tables are two road users, whatever their numbers.
    """
    pedestrians, checks = list[Track](), Checks()
    for part in parts:
        checks.add(part.road_users)
        own, taken = ({track.number for track in tracks} for tracks in (part.pedestrians, pedestrians))
        more = 1 + max(taken) - min(own) if own & taken else 0
        pedestrians += [replace(t, number=t.number + more, name=t.name or str(t.number)) for t in part.pedestrians]
    return replace(
        parts[0],
        vehicles=[track for part in parts for track in part.vehicles],
        pedestrians=pedestrians,
        left_out=sum((Counter(part.left_out) for part in parts), Counter()),
        road_users=checks,
        assumed=tuple(dict.fromkeys(text for part in parts for text in part.assumed)),
    )


@dataclass(frozen=True)
class Importer:
    """A format of recordings that `vpsci import` reads.

    :ivar read: folder of recordings -> its clips, in an order of its own that is always the same; raises
        `InvalidInput` where the folder or a file does not hold what it should.
    :ivar length, width: of a vehicle [m] whose track and clip do not say.
    :ivar frame_rate: of recordings as published [1/s]; `read` takes another as `frame_rate`. 0: the files say it.
    """

    read: Callable[..., Iterable[Clip]]
    length: float
    width: float
    frame_rate: float = 0.0


def require_source(name: object, where: str) -> None:
    """Refuse what cannot be the name of a source.

    :param where: what gives the name, the opening of the error message.
    """
    if not isinstance(name, str) or not name.replace("_", "").replace("-", "").isalnum():
        raise InvalidInput(f"{where} {shown(name)}: expected letters, digits, _ and -")


def median_speed(*pedestrian: Track) -> float:
    """Return the median speed [m/s] of a pedestrian while it moves (above 0.5 m/s), 0 where it never moves."""
    speed = np.concatenate([np.hypot(track.values["vx"], track.values["vy"]) for track in pedestrian])
    return float(np.median(speed[speed > _WALKS])) if (speed > _WALKS).any() else 0.0


def read_csv(path: Path, delimiter: str = ",", *, header: bool = True) -> pl.DataFrame:
    """Return a CSV file with every value as text, without byte order mark, spaces around values and ".0" at their end.

    UTF-16 is known by its mark. A first line without `delimiter` may have ";" or tabs, with which decimal commas are
    allowed. Table programs add the ".0" to whole numbers.

    :param header: the first line has the names of columns; without it they are called 1, 2, and so on.
    :raises InvalidInput: it cannot be read, is a file of another kind, has no row, or two columns have one name.
    """
    require_regular(path)
    try:
        data = path.read_bytes()
        if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            data = data.decode("utf-16").encode()
        if what := foreign(data):
            raise InvalidInput(f"{path}: expected CSV, got {what}")
        line = data.partition(b"\n")[0]
        if len(line) > LONGEST_LINE:  # it is no table, or has no line breaks
            raise InvalidInput(
                f"{path}: its first line has {len(line) / 1e6:,.2g} MB; expected a line of columns, of at most "
                f"{LONGEST_LINE // 1024} kB, and one row a frame and road user below it"
            )
        first = line.decode("utf-8-sig")
        delimiter = next((each for each in (delimiter, ";", "\t") if each in first), delimiter)
        mark, lines = delimiter.encode(), data.removeprefix(codecs.BOM_UTF8)[: 2 * LONGEST_LINE].split(b"\n")[:-1]
        count = next((n for n, line in enumerate(lines) if not line.startswith((b"#", b"%", b"//"))), 0)
        if count and (count > 1 or lines[0].count(mark) != lines[1].count(mark)):
            raise InvalidInput(
                f"{path}: begins with comments ({shown(lines[0].decode(errors='replace').strip())}); expected the "
                f"names of columns in line 1: remove the first {count} lines"
            )
        table = pl.read_csv(data, infer_schema=False, separator=delimiter, has_header=header)
        table.columns = [name.strip() if header else str(i + 1) for i, name in enumerate(table.columns)]
    except (pl.exceptions.PolarsError, OSError, UnicodeError) as error:
        words = reason(error)
        if isinstance(error, pl.exceptions.PolarsError) and b'"' not in data:  # quotes hide delimiters
            counts = [line.count(delimiter.encode()) + 1 for line in data.split(b"\n")]
            if long := next((number for number, count in enumerate(counts) if count > counts[0]), 0):
                words = f"line {long + 1} has {counts[long]} values, line 1 has {counts[0]}"
        raise InvalidInput(f"{path}: not readable as CSV: {words}; take the file as published") from error
    if table.is_empty():
        raise InvalidInput(f"{path}: expected one row a frame and road user, got none; remove the file or restore it")
    text = pl.all().str.strip_chars()
    if delimiter != ",":
        text = text.str.replace(r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$", "${1}.${2}")
    return table.with_columns(text.str.replace(WHOLE, "${1}"))


def hypot(x: str | pl.Expr, y: str | pl.Expr) -> pl.Expr:
    """Return the length of a vector."""
    x, y = (pl.col(each) if isinstance(each, str) else each for each in (x, y))
    return (x**2 + y**2).sqrt()


def alike(values: pl.Series) -> pl.Series:
    """Return values as text in which equal numbers are equal, however written: 2, 2.0, 2.000e+00."""
    text = values.cast(pl.String).str.strip_chars()
    number = pl.lit(text.cast(pl.Float64, strict=False))
    number = pl.when(number.is_finite()).then(number)
    whole = pl.when((number == number.round()) & (number.abs() < LARGEST)).then(number).cast(pl.Int64, strict=False)
    return pl.select(pl.coalesce(whole.cast(pl.String), number.cast(pl.String), pl.lit(text))).to_series()


def require_columns(table: pl.DataFrame, names: Iterable[str], path: Path) -> None:
    """Refuse a table in which one of these columns is missing."""
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise InvalidInput(
            f"{path}: column {', '.join(missing)} is missing; it has "
            f"{listed((name for name in table.columns if name != LINE), 20)}"
        )


def spaces(table: pl.DataFrame, frame_rate: float) -> pl.DataFrame:
    """Return, for each row of a road user but the last, the id and the seconds to the next row."""
    return table.select("id", seconds=pl.col("frame").diff().over("id") / frame_rate).drop_nulls()


def spacing(table: pl.DataFrame, frame_rate: float) -> float:
    """Return the time between two rows of a road user [s]: the median over road users of the median of each.

    0 where no road user has two rows.
    """
    each = spaces(table, frame_rate).group_by("id").median()["seconds"].to_numpy()
    return float(np.median(each)) if len(each) else 0.0


def longest_gap(table: pl.DataFrame, frame_rate: float, path: Path) -> float:
    """Return the time between two rows [s] beyond which a track is cut: `MAX_GAP`, or more if the rows are sparse.

    :raises InvalidInput: rows are further apart than `SPARSEST`.
    """
    apart = spacing(table, frame_rate)
    if apart > SPARSEST * (1.0 + _SLACK):
        raise Unusable(
            f"clips whose rows are more than {SPARSEST:g} s apart",
            f"{path}: rows of a road user are {apart:.3g} s apart (median); expected at most {SPARSEST:g} s, since "
            "motion between rows is interpolated; check the frame rate or the unit of time, or take a recording of "
            "more rows",
        )
    return max(MAX_GAP, _BRIDGED * apart)


def resample(
    table: pl.DataFrame, frame_rate: float, angle: str | None = None, gap: float = MAX_GAP, fastest: float = np.inf
) -> Iterator[Track]:
    """Yield each id's unbroken pieces on the 0.1 s grid, frame 0 being time 0.

    Values between two frames are interpolated linearly, `angle` [rad] after unwrapping; nothing is extrapolated, and
    no value is made across a gap. Pieces that hold no grid point do not appear.

    :param frame_rate: of the recording [1/s].
    :param gap: time between two rows [s] beyond which a track is cut, see `longest_gap`.
    :param fastest: speed from one row to the next [m/s] beyond which a track is cut; needs columns x and y [m].
    """
    if table.is_empty():
        return
    columns = {name: table[name].to_numpy() for name in table.columns}
    _, begins, which = np.unique(columns["id"], return_index=True, return_inverse=True)
    order = np.argsort(begins[which], kind="stable")  # ids as they first appear, the rows of each together
    number, time = columns["id"][order], columns["frame"][order] / frame_rate
    raw = {name: columns[name][order] for name in table.columns[2:]}
    ends = (np.diff(number) != 0) | (np.diff(time) > gap)
    if np.isfinite(fastest):
        ends |= np.hypot(np.diff(raw["x"]), np.diff(raw["y"])) > fastest * np.diff(time)
    cuts = np.flatnonzero(ends) + 1
    for begin, end in itertools.pairwise([0, *cuts.tolist(), len(time)]):
        own = time[begin:end]
        first = int(np.ceil(own[0] / STEP - _GRID))
        steps = np.arange(first, int(np.floor(own[-1] / STEP + _GRID)) + 1)
        if len(steps) == 0:
            continue
        values = {}
        for name, column in raw.items():
            piece = column[begin:end]
            values[name] = np.interp(steps * STEP, own, np.unwrap(piece) if name == angle else piece)
        yield Track(int(number[begin]), first, values)
