"""One odd clip never refuses a corpus: a check leaves out the road user or clip that fails it, and counts it."""

import io
import re
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from rich.console import Console

from vpsci_ros.data.importers import ImportResult, import_folders, import_trajectories, print_import_summary
from vpsci_ros.data.importers.layout import CHANGES, NAMELESS, PLACELESS
from vpsci_ros.data.near_misses import read_near_misses, write_near_misses
from vpsci_ros.errors import InvalidInput

ROOT = Path(__file__).resolve().parents[2]
COLUMNS = ["frame", "id", "class", "x", "y", "speed", "yaw", "l", "w"]
LAYOUT = """columns: {frame: frame, id: id, class: class, x: x, y: y, speed: speed, heading: yaw, length: l, width: w}
vehicles: [car]
pedestrians: [person]
frame_rate: 10
"""
CLIPS, ODD = 6, 3  # clips of a corpus, and the number of the odd one


def clip(frames: int = 120) -> pl.DataFrame:
    """Return a car at 5 m/s along x, and a walker at 1.3 m/s who crosses its path when it comes."""
    k = np.arange(frames)
    t, zero = 0.1 * k, np.zeros(frames)
    car = {"x": 5.0 * t - 30.0, "y": zero, "speed": zero + 5.0, "yaw": zero, "l": zero + 4.5, "w": zero + 1.8}
    person = {"x": zero + 0.3, "y": 1.3 * t - 9.0, "speed": zero + 1.3, "yaw": zero, "l": zero, "w": zero}
    rows = [pl.DataFrame({"frame": k, "id": i, "class": name} | values)
            for i, name, values in ((1, "car", car), (2, "person", person))]  # fmt: skip
    return pl.concat(rows).select(COLUMNS)


def another(number: int, kind: str, **values: object) -> pl.DataFrame:
    """Return a third road user: the rows of the first one with other values."""
    own = clip().filter(pl.col("id") == (1 if kind == "car" else 2))
    return own.with_columns(id=pl.lit(number), **{name: pl.lit(value) for name, value in values.items()})


def creeps() -> pl.DataFrame:
    way = 60.0 + 0.064 * np.arange(120)
    return pl.concat([clip(), another(3, "car", x=pl.Series(way), y=40.0, speed=0.02)])


def side_by_side(count: int = 4) -> pl.DataFrame:
    ride = pl.Series(-20.0 + 0.28 * np.arange(120))
    riders = [another(10 + i, "person", x=ride, y=30.0 + 1.5 * i, speed=2.8) for i in range(count)]
    return pl.concat([clip().filter(pl.col("id") == 1), *riders])


def drives() -> pl.DataFrame:
    way = pl.Series(-80.0 + 1.4 * np.arange(120))
    return pl.concat([clip().filter(pl.col("id") == 1), another(2, "person", y=way, speed=14.0)])


CAR = pl.col("class") == "car"
ODD_CLIPS = {  # what is odd -> the clip, whom it costs, and how many of them
    "a speed that the positions contradict": (creeps, "vehicles whose speeds contradict their positions", 1),
    "bicycles side by side": (side_by_side, "pedestrians that all move alike", 4),
    "many bicycles side by side": (lambda: side_by_side(30), "pedestrians that all move alike", 30),
    "a car with the class of a person": (drives, "pedestrians faster than 12 m/s", 1),
    "speeds in km/h": (
        lambda: clip().with_columns(speed=pl.when(CAR).then(18.0).otherwise("speed")), "vehicles whose speeds", 1
    ),
    "headings that point back": (lambda: clip().with_columns(pl.col("yaw") + 3.1), "vehicles whose headings", 1),
    "sizes in centimetres": (lambda: clip().with_columns(pl.col("l", "w") * 100.0), "vehicles of a size", 1),
    "positions in degrees": (
        lambda: clip().with_columns(pl.col("x", "y", "speed") * 1e-5),
        "pedestrians in clips whose positions are no metres",
        1,
    ),
    "a row a second": (lambda: clip().filter(pl.col("frame") % 10 == 0), "clips whose rows are more than 0.5 s", 1),
    "an id for each row": (
        lambda: clip().with_columns(id=pl.int_range(pl.len())), "clips in which most road users have one row", 1
    ),
    "a missing column": (lambda: clip().drop("y"), "clips that cannot be read", 1),
    "no row": (lambda: clip().head(0), "clips that cannot be read", 1),
    "words in place of numbers": (
        lambda: clip().with_columns(x=pl.when(CAR).then(pl.lit("far")).otherwise(pl.lit("0"))),
        "vehicles that cannot be read",
        1,
    ),
    "frames that come twice": (
        lambda: pl.concat([clip(), clip().filter(CAR).with_columns(pl.col("y") + 0.1)]), "vehicles that cannot be", 1
    ),
}  # fmt: skip


def write(folder: Path, odd: pl.DataFrame, which: tuple[int, ...] = (ODD,), layout: str = LAYOUT) -> Path:
    folder.mkdir(exist_ok=True, parents=True)
    for number in range(CLIPS):
        (odd if number in which else clip()).write_csv(folder / f"clip{number}.csv")
    (folder / "layout.yaml").write_text(layout)
    return folder


def said(result: ImportResult) -> list[str]:
    out = io.StringIO()
    print_import_summary(result, Console(file=out, width=80))
    return out.getvalue().splitlines()


@pytest.mark.parametrize("name", ODD_CLIPS)
def test_one_odd_clip_is_left_out_and_counted_with_an_example_and_most_are_refused_with_the_share(
    name: str, tmp_path: Path
) -> None:
    odd, what, count = ODD_CLIPS[name]
    folder = write(tmp_path / "one", odd())
    result = import_trajectories(folder, "described")
    (summary,) = result.summaries
    sound = 1 if name == "a speed that the positions contradict" else 0
    assert summary.near_misses == CLIPS - 1 + sound
    ((found, own),) = ((what, own) for what, own in summary.checks.items() if own.count)
    assert found.startswith(what)
    assert (own.count, summary.left_out[found]) == (count, count)
    assert "clip3" in own.example
    *_, last = said(result)
    left = 0 if found.startswith("clips") else count
    assert re.fullmatch(rf"{CLIPS - 1 + sound} near misses; \d+ road users used, {left} left out", last)
    assert any(line.startswith(f"described: left out: {found}: {count} of ") for line in said(result))
    with pytest.raises(InvalidInput, match="clip3"):
        import_trajectories(folder, "described", strict=True)
    if sound:
        return  # a car more or less in each clip is never most of the cars
    most = write(tmp_path / "most", odd(), which=(0, 1, 3, 5))
    with pytest.raises(InvalidInput, match=rf"{what}.*: \d+ of \d+ \(\d+%\), so most; the first: .*clip0"):
        import_trajectories(most, "described")


def test_the_only_clip_of_one_of_several_folders_may_be_odd(tmp_path: Path) -> None:
    folders = [write(tmp_path / "sound", clip()), tmp_path / "odd"]
    folders[1].mkdir()
    drives().write_csv(folders[1] / "only.csv")
    (folders[1] / "layout.yaml").write_text(LAYOUT)
    result = import_folders(folders, ["described"])
    assert (result.summaries[0].near_misses, result.summaries[0].unused) == (CLIPS, 1)
    with pytest.raises(InvalidInput, match="1 of 1 .100%., so most"):
        import_folders(folders[1:], ["described"])


REMEDIES = {  # what is wrong -> rows, and keys to begin with
    "km/h": lambda: clip().with_columns(pl.col("speed") * 3.6),
    "frame rate": lambda: clip().with_columns(pl.col("frame") * 2),
    "headings from north": lambda: clip().with_columns(yaw=90.0 - pl.col("yaw").degrees()),
    "sizes": lambda: clip().with_columns(pl.col("l", "w") * 100.0),
    "moving sensor": side_by_side,
}


@pytest.mark.parametrize("name", REMEDIES)
def test_the_remedy_that_a_message_names_works(name: str, tmp_path: Path) -> None:
    folder = write(tmp_path, REMEDIES[name](), which=tuple(range(CLIPS)))
    with pytest.raises(InvalidInput) as refused:
        import_trajectories(folder, "described")
    keys = re.findall(r"`([^`.]+: [^`.]*(?:\d\.\d+)?[^`.]*)`", str(refused.value))
    keys = [key for key in keys if "..." not in key]
    assert keys, refused.value
    named = {key.partition(":")[0] for key in keys}
    kept = [line for line in LAYOUT.splitlines() if line.partition(":")[0] not in named]
    (folder / "layout.yaml").write_text("\n".join([*kept, *keys]) + "\n")
    assert import_trajectories(folder, "described").summaries[0].pedestrians >= CLIPS


def interaction(folder: Path, *, factor: float = 1.0, riders: int = 4) -> None:
    """Write three clips of INTERACTION: a car, and a walker or, in clip 1, riders side by side; all of one class."""
    place = folder / "recorded_trackfiles/DR_USA_Intersection_EP0"
    place.mkdir(parents=True)
    own = clip().with_columns(frame_id="frame", timestamp_ms=100 * pl.col("frame"), psi_rad="yaw", vy=pl.lit(0.0))
    columns = ["track_id", "frame_id", "timestamp_ms", "agent_type", "x", "y", "vx", "vy"]
    cars = own.filter(CAR).with_columns(track_id="id", agent_type="class", vx=factor * pl.col("speed"))
    cars = cars.select(*columns, "psi_rad", length="l", width="w")
    walker = own.filter(~CAR).with_columns(agent_type=pl.lit("pedestrian/bicycle"), vx=pl.lit(0.0))
    walkers = walker.with_columns(track_id=pl.lit("P1"), vy="speed").select(columns)
    ride = {"y": pl.Series(0.27 * (np.arange(120.0) - 60.0)), "vy": pl.lit(2.7)}
    rides = [
        walker.with_columns(track_id=pl.lit(f"P{k}"), x=pl.lit(0.3 + 1.5 * k), **ride).select(columns)
        for k in range(riders)
    ]
    for number in range(3):
        cars.write_csv(place / f"vehicle_tracks_{number:03}.csv")
        people = pl.concat(rides) if number == 1 and rides else walkers
        people.write_csv(place / f"pedestrian_tracks_{number:03}.csv")


def test_a_published_format_is_told_no_key_of_a_layout(tmp_path: Path) -> None:
    pytest.importorskip("vpsci_ros.extras.formats")
    interaction(tmp_path, factor=2.0)
    with pytest.raises(InvalidInput, match="vehicles whose speeds contradict .*: 3 of 3 .100%.") as refused:
        import_trajectories(tmp_path, "interaction")
    assert not re.search(r"`|layout|leave the column", str(refused.value))


def test_riders_side_by_side_are_left_out_of_interaction_and_fewer_are_cyclists_on_request(tmp_path: Path) -> None:
    pytest.importorskip("vpsci_ros.extras.formats")
    interaction(tmp_path / "four")
    summary = import_trajectories(tmp_path / "four", "interaction").summaries[0]
    assert (summary.near_misses, summary.unused) == (2, 4)
    interaction(tmp_path / "two", riders=2)
    result = import_trajectories(tmp_path / "two", "interaction")
    assert result.table["kind"].unique().to_list() == ["walker"]
    assert result.summaries[0].left_out == {"cyclists, which `--kinds cyclist` imports": 2}
    both = import_trajectories(tmp_path / "two", "interaction", kinds=("walker", "cyclist"))
    kinds = dict(both.table.group_by("kind").agg(pl.col("interaction").n_unique()).rows())
    assert kinds == {"walker": 2, "cyclist": 2}
    with pytest.raises(InvalidInput, match="--kinds cyclists: expected one or some of walker,cyclist,scooter"):
        import_trajectories(tmp_path / "two", "interaction", kinds=("cyclists",))


def test_people_learn_from_walkers_alone_and_a_table_without_kinds_holds_walkers(tmp_path: Path) -> None:
    pytest.importorskip("vpsci_ros.extras.formats")
    interaction(tmp_path / "r", riders=2)
    both = import_trajectories(tmp_path / "r", "interaction", kinds=("walker", "cyclist"))
    write_near_misses(both.table, tmp_path / "both.parquet", both.metadata)
    assert read_near_misses(tmp_path / "both.parquet")["kind"].unique().to_list() == ["walker"]
    assert read_near_misses(tmp_path / "both.parquet", ("cyclist",))["interaction"].n_unique() == 2
    cyclists = both.table.filter(pl.col("kind") == "cyclist")
    write_near_misses(cyclists, tmp_path / "cyclists.parquet")
    with pytest.raises(InvalidInput, match="no near miss of a walker, but of cyclist; import .* `--kinds walker`"):
        read_near_misses(tmp_path / "cyclists.parquet")
    both.table.drop("kind").write_parquet(tmp_path / "older.parquet")
    assert read_near_misses(tmp_path / "older.parquet")["interaction"].n_unique() == 4
    with pytest.raises(InvalidInput, match="column kind, row 0 .* expected walker or cyclist or scooter, got biker"):
        write_near_misses(both.table.with_columns(kind=pl.lit("biker")), tmp_path / "o.parquet")


@pytest.mark.parametrize(
    ("classes", "layout", "kinds"),
    [
        (("Biker", "Pedestrian"), "pedestrians: [Pedestrian, Biker]", {"cyclist", "walker"}),
        ((3, 1), "pedestrians: [1]\ncyclists: [3]", {"cyclist", "walker"}),
        ((3, 1), "pedestrians: [1, 3]", {"walker"}),  # at a walker's speed
        (("e", "person"), "pedestrians: [person]\nscooters: [e]", {"scooter", "walker"}),
    ],
)
def test_classes_of_a_layout_say_the_kind(
    classes: tuple[object, object], layout: str, kinds: set[str], tmp_path: Path
) -> None:
    third = another(3, "person", x=1.3).with_columns(pl.lit(str(classes[0])).alias("class"))
    table = pl.concat([clip().with_columns(pl.col("class").replace("person", str(classes[1]))), third])
    folder = write(tmp_path, table, tuple(range(CLIPS)), LAYOUT.replace("pedestrians: [person]", layout))
    found = import_trajectories(folder, "described", kinds=("walker", "cyclist", "scooter"))
    assert set(found.table["kind"]) == kinds


@pytest.mark.parametrize(
    ("file", "layout"), [("2.000000000000000000e+00", "2"), ("2.0", "2"), ("2", "2.0"), (" 2", "'+2'"), ("2.50", "2.5")]
)
def test_equal_numbers_are_one_class_however_written(file: str, layout: str, tmp_path: Path) -> None:
    table = clip().with_columns(pl.when(CAR).then(pl.lit(file)).otherwise(pl.lit("1e0")).alias("class"))
    own = LAYOUT.replace("[car]", f"[{layout}]").replace("[person]", "[1]")
    folder = write(tmp_path, table, tuple(range(CLIPS)), own)
    assert import_trajectories(folder, "described").summaries[0].near_misses == CLIPS


def renamed(first: int, last: int, kind: str) -> pl.Expr:
    """Return classes of which that of the walker is `kind` from one frame to another."""
    own = (pl.col("id") == 2) & pl.col("frame").is_between(first, last)
    return pl.when(own).then(pl.lit(kind)).otherwise(pl.col("class")).alias("class")


@pytest.mark.parametrize("kind", ["car", "dog", None])
def test_a_class_that_changes_for_some_frames_counts_by_majority(kind: str | None, tmp_path: Path) -> None:
    odd = clip().with_columns(renamed(50, 75, kind))
    result = import_trajectories(write(tmp_path, odd), "described")
    plain = import_trajectories(write(tmp_path / "plain", clip(), ()), "described")
    assert result.table.equals(plain.table)
    assert result.summaries[0].left_out == {CHANGES: 1}


def test_two_road_users_of_one_id_keep_their_classes(tmp_path: Path) -> None:
    later = another(2, "car").with_columns(pl.col("frame") + 200)
    at_once = another(2, "car", y=60.0)
    for name, table in (("later", later), ("at once", at_once)):
        result = import_trajectories(write(tmp_path / name, pl.concat([clip(), table])), "described")
        assert CHANGES not in result.summaries[0].left_out, name
        assert result.summaries[0].near_misses == CLIPS, name


@pytest.mark.parametrize("value", ["nan", "NaN", ""])
def test_a_row_without_a_position_is_dropped_as_one_without_an_id_is(value: str, tmp_path: Path) -> None:
    odd = clip().with_columns(pl.col("x", "id").cast(pl.String))
    odd = odd.with_columns(x=pl.when(pl.col("frame") == 60).then(pl.lit(value)).otherwise("x"))
    odd = odd.with_columns(id=pl.when(pl.col("frame") == 62).then(pl.lit("")).otherwise("id"))
    (summary,) = import_trajectories(write(tmp_path, odd), "described").summaries
    assert summary.left_out == {PLACELESS: 2, NAMELESS: 2}
    assert summary.near_misses == CLIPS


def test_times_of_an_epoch_in_single_precision_are_named_as_lost_precision(tmp_path: Path) -> None:
    layout = LAYOUT.replace("frame: frame", "time: t").replace("frame_rate: 10\n", 'files: "*.parquet"\n')
    for kind, name in ((pl.Float64, "double"), (pl.Float32, "single")):
        folder = write(tmp_path / name, clip(), (), layout)
        table = clip().with_columns(t=(1.7e9 + 0.1 * pl.col("frame")).cast(kind)).drop("frame")
        table.write_parquet(folder / "a.parquet")
        if name == "double":
            assert import_trajectories(folder, "described").summaries[0].near_misses == 1
            continue
        said = "column t: times have lost their precision: .*float32. they are 128 s apart at 17000000.*float64"
        with pytest.raises(InvalidInput, match=said) as refused:
            import_trajectories(folder, "described")
        assert "twice" not in str(refused.value)


def recordings(data: Path, name: str, into: Path) -> tuple[list[Path], list[str]]:
    """Return folders of a real recording and their formats; a layout of examples/ is copied beside a copy."""
    if name == "vci":
        return [data / "vci_dut", data / "vci_citr"], ["vci-dut", "vci-citr"]
    if name == "cqut-pvi":
        return [data / "cqut_pvi"], [name]
    source = {"hc": "hc", "hc merged": "hc", "taf-bw": "taf_bw/recorded_trackfiles"}[name]
    shutil.copytree(data / source, into)
    layout = "taf-bw" if name == "taf-bw" else "hc"
    shutil.copy(ROOT / f"examples/layouts/{layout}.yaml", into / "layout.yaml")
    if name == "hc merged":  # as its publishers merge it: frames and ids behind one another, by numpy's savetxt
        parts = [np.loadtxt(path, delimiter=",") for path in sorted(into.glob("*.csv"))]
        more = np.cumsum([[0.0, 0.0]] + [part[:, :2].max(axis=0) + 1 for part in parts[:-1]], axis=0)
        np.savetxt(
            into / "all",
            np.concatenate([p + np.array([*m, 0, 0, 0]) for p, m in zip(parts, more, strict=True)]),
            delimiter=",",
        )
        for path in into.glob("*.csv"):
            path.unlink()
        (into / "all").rename(into / "all.csv")
    return [into], ["described"]


@pytest.mark.parametrize(
    ("name", "near", "used", "unused", "counts"),
    [
        ("vci", 346, 1289, 0, {}),
        ("cqut-pvi", 747, 3008, 412, {}),
        ("hc", 208, 422, 15, {}),
        ("hc merged", 208, 422, 15, {}),
        ("taf-bw", 5, 218, 0, {}),
    ],
)
def test_what_each_check_leaves_out_of_each_real_recording(
    name: str, near: int, used: int, unused: int, counts: dict[str, int], real_data: Path, tmp_path: Path
) -> None:
    folders, formats = recordings(real_data, name, tmp_path / "r")
    result = import_folders(folders, formats)
    checks = {what: own.count for one in result.summaries for what, own in one.checks.items() if own.count}
    assert checks == counts
    total = [sum(getattr(one, what) for one in result.summaries) for what in ("near_misses", "used", "unused")]
    assert total == [near, used, unused]
