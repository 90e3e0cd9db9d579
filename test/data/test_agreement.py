"""What recordings say twice is compared: speeds, velocities, headings, sizes, distances, and the frame of positions."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vpsci_ros.bags.reader import Bag
from vpsci_ros.data.importers import ImportResult, import_trajectories
from vpsci_ros.data.importers.described import described
from vpsci_ros.data.importers.layout import TURNS
from vpsci_ros.data.importers.layout_file import ANGLES, HEADINGS, LENGTHS, SPEEDS
from vpsci_ros.data.importers.pairs import near_misses_of
from vpsci_ros.data.importers.tracks import BACKWARDS
from vpsci_ros.data.parquet import read_parquet
from vpsci_ros.errors import InvalidInput

CAR, WALK, COURSE = 5.0, 1.3, 2.43  # [m/s], [m/s], [rad] of the car
COLUMNS = {"id": "id", "time": "t", "class": "kind", "x": "x", "y": "y"}


def scene(seconds: float = 6.0) -> pl.DataFrame:
    """Return a car at 5 m/s that meets a pedestrian after 5 s, at 10 Hz, with speed [m/s] and heading [rad]."""
    t = np.arange(0.0, seconds, 0.1)
    along, across = np.array([np.cos(COURSE), np.sin(COURSE)]), np.array([-np.sin(COURSE), np.cos(COURSE)])
    parts = []
    for number, kind, way, speed, turn in ((1, "car", along, CAR, 0.0), (2, "ped", across, WALK, 0.5 * np.pi)):
        x, y = (speed * (t - 5.0) * each for each in way)
        parts.append(pl.DataFrame({"id": number, "t": t, "kind": kind, "x": x, "y": y}))
        parts[-1] = parts[-1].with_columns(speed=speed, heading=COURSE + turn, vx=speed * way[0], vy=speed * way[1])
    return pl.concat(parts).with_columns(length=pl.lit(4.5), width=pl.lit(1.8))


def imported(folder: Path, table: pl.DataFrame, *columns: str, **layout: str) -> ImportResult:
    """Import a table by a layout with further columns of their own names, and further keys."""
    table.write_csv(folder / "a.csv")
    names = COLUMNS | {name: name for name in columns}
    keys = {"columns": str(names).replace("'", ""), "vehicles": "[car]", "pedestrians": "[ped]"} | layout
    (folder / "layout.yaml").write_text("".join(f"{key}: {value}\n" for key, value in keys.items()))
    return import_trajectories(folder, "described")


@pytest.mark.parametrize("unit", [unit for unit in SPEEDS if unit != "m/s"])
def test_a_speed_of_another_unit_is_refused_with_both_numbers_and_read_when_the_unit_is_said(
    unit: str, tmp_path: Path
) -> None:
    other = scene().with_columns(pl.col("speed") / SPEEDS[unit])
    said = rf"column speed says .+ m/s, positions and times say .+ m/s .*likely in {unit}: `units: {{speed: {unit}}}`"
    with pytest.raises(InvalidInput, match=said):
        imported(tmp_path, other, "speed")
    table = imported(tmp_path, other, "speed", units=f"{{speed: {unit}}}").table
    assert table["veh_speed"].to_numpy() == pytest.approx(CAR)


def test_a_speed_of_pedestrians_is_compared_though_positions_say_theirs(tmp_path: Path) -> None:
    wrong = pl.when(pl.col("kind") == "ped").then(3.6 * WALK).otherwise(CAR)
    with pytest.raises(InvalidInput, match=r"column speed says 4.68 m/s, positions and times say 1.3 m/s .*km/h"):
        imported(tmp_path, scene().with_columns(speed=wrong), "speed")
    unknown = pl.when(pl.col("kind") == "car").then(CAR)
    assert imported(tmp_path, scene().with_columns(speed=unknown), "speed").summaries[0].near_misses == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"vx": -pl.col("vy"), "vy": pl.col("vx")}, "column vx and vy: velocities point 1.57 rad away from the motion"),
        ({"vx": 0.0 * pl.col("vx"), "vy": 0.0 * pl.col("vy")}, "says 0 m/s, positions and times say"),
        ({"vx": 3.6 * pl.col("vx"), "vy": 3.6 * pl.col("vy")}, "likely in km/h"),
        ({"t": 2.0 * pl.col("t")}, r"0.5 times as much; they fit `time_unit: 0.5` \(here 1\)"),
    ],
)
def test_velocities_that_contradict_positions_are_refused(change: dict, said: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=said):
        imported(tmp_path, scene().with_columns(**change), "vx", "vy")


@pytest.mark.parametrize("unit", ANGLES)
@pytest.mark.parametrize("way", HEADINGS)
def test_a_heading_of_another_unit_or_axis_is_refused_and_the_layout_named_that_reads_it(
    way: str, unit: str, tmp_path: Path
) -> None:
    times, plus = HEADINGS[way]
    measured = scene().with_columns(heading=(pl.col("heading") - plus) / times / ANGLES[unit])
    right = {"units": f"{{angle: {unit}}}", "heading": way}
    table = imported(tmp_path, measured, "heading", **right).table
    assert np.cos(table["veh_heading"].to_numpy() - COURSE) == pytest.approx(1.0)
    same = "from x to y" if way == "counter-clockwise from x" else way
    if times != 1.0 or plus != 0.0 or unit != "rad":
        with pytest.raises(InvalidInput, match=rf"they fit `units: {{angle: {unit}}}` and `heading: {same}`"):
            imported(tmp_path, measured, "heading")


def test_with_y_down_headings_from_x_to_y_are_those_of_the_picture_and_others_those_from_above(tmp_path: Path) -> None:
    down = scene().with_columns(-pl.col("y"))
    for heading, way in ((-pl.col("heading"), "from x to y"), (pl.col("heading"), "counter-clockwise from x")):
        table = imported(tmp_path, down.with_columns(heading=heading), "heading", y_down="true", heading=way).table
        assert table["veh_heading"].to_numpy() == pytest.approx(COURSE)


@pytest.mark.parametrize("unit", [unit for unit in LENGTHS if unit != "m"])
def test_sizes_that_no_vehicle_has_are_refused_with_the_likely_unit(unit: str, tmp_path: Path) -> None:
    other = scene().with_columns(pl.col("length", "width") / LENGTHS[unit])
    with pytest.raises(
        InvalidInput, match=f"columns length and width: the median vehicle is .*units: {{size: {unit}}}"
    ):
        imported(tmp_path, other, "length", "width")
    assert imported(tmp_path, other, "length", "width", units=f"{{size: {unit}}}").table["veh_length"][0] == 4.5
    with pytest.raises(InvalidInput, match="may be exchanged"):
        imported(tmp_path, scene().rename({"length": "width", "width": "length"}), "length", "width")


def pair(table: pl.DataFrame) -> pl.DataFrame:
    """Return the scene with both in a row, without ids."""
    sides = [table.filter(pl.col("kind") == kind).select("t", "x", "y") for kind in ("car", "ped")]
    both = sides[0].join(sides[1].rename({"x": "px", "y": "py"}), on="t")
    return both.with_columns(gap=((pl.col("x") - pl.col("px")) ** 2 + (pl.col("y") - pl.col("py")) ** 2).sqrt())


PAIR = "columns: {time: t%s}\nvehicle: {x: x, y: y}\npedestrian: {x: px, y: py}\n"


def test_rows_of_one_car_and_one_pedestrian_need_no_ids_and_their_distance_is_compared(tmp_path: Path) -> None:
    pair(scene()).write_csv(tmp_path / "a.csv")
    (tmp_path / "layout.yaml").write_text(PAIR % ", distance: gap")
    (summary,) = import_trajectories(tmp_path, "described").summaries
    assert (summary.vehicles, summary.pedestrians, summary.near_misses) == (1, 1, 1)
    pair(scene()).with_columns(pl.col("gap") * 3.28).write_csv(tmp_path / "a.csv")
    with pytest.raises(InvalidInput, match=r"column gap says 34.7 m, the positions are 10.6 m apart \(medians\)"):
        import_trajectories(tmp_path, "described")
    (tmp_path / "layout.yaml").write_text(PAIR.replace("px, y", "px, z") % "")
    with pytest.raises(InvalidInput, match="pedestrian: z: unknown; expected id, frame"):
        import_trajectories(tmp_path, "described")


def moving(table: pl.DataFrame, count: int, speed: float) -> pl.DataFrame:
    """Return `count` copies of the scene in the frame of a sensor that drives along x at `speed` [m/s]."""
    seen = table.with_columns(x=pl.col("x") - speed * pl.col("t"))
    return pl.concat(seen.with_columns(pl.col("id") + 2 * k, pl.col("t") + 20.0 * k) for k in range(count))


def test_positions_in_the_frame_of_a_moving_sensor_are_refused_unless_told(tmp_path: Path) -> None:
    table = moving(scene(), 3, 8.0)
    said = "the mean velocity of 3 pedestrians is 8.9 m/s, as in the frame of a moving sensor; .*fixed: true"
    with pytest.raises(InvalidInput, match=said):
        imported(tmp_path, table)
    with pytest.raises(InvalidInput, match=said):
        import_trajectories(tmp_path, "described", fastest=2.5)
    assert imported(tmp_path, table, fixed="true").summaries[0].pedestrians == 3
    assert imported(tmp_path, moving(scene(), 3, 0.0)).summaries[0].near_misses == 3
    with pytest.raises(
        InvalidInput, match="rows of pedestrians are faster than 12 m/s; .* relative to a moving sensor"
    ):
        imported(tmp_path, moving(scene(), 3, 20.0))
    (clip,) = described(tmp_path) if imported(tmp_path, table, fixed="true") else ()
    with pytest.raises(InvalidInput, match="own: the mean velocity of 3|own, clip a: the mean velocity of 3"):
        near_misses_of("own", [replace(clip, source="", fixed=False)], length=4.5, width=1.8, strict=True)


@pytest.mark.parametrize(
    ("factor", "turn", "said"),
    [
        (3.6, 0.0, r"own, clip a: vehicles say speeds of 18 m/s, their positions 5 m/s"),
        (1.0, 1.0, "own, clip a: directions of vehicles differ from the motion of their positions by 1.00 rad"),
    ],
)
def test_clips_of_any_importer_are_compared(factor: float, turn: float, said: str, tmp_path: Path) -> None:
    imported(tmp_path, scene())
    (clip,) = described(tmp_path)
    (car,) = clip.vehicles
    values = car.values | {"speed": factor * car.values["speed"], "heading": car.values["heading"] + turn}
    with pytest.raises(InvalidInput, match=said):
        near_misses_of(
            "own", [replace(clip, vehicles=[replace(car, values=values)])], length=4.5, width=1.8, strict=True
        )


def test_a_car_that_reverses_keeps_what_it_drove_forward_and_the_rest_is_counted(tmp_path: Path) -> None:
    t = np.arange(0.0, 16.0, 0.1)
    way = np.interp(t, [0.0, 8.0, 12.0, 16.0], [-25.0, 15.0, 15.0, 11.0])
    car = scene().filter(pl.col("kind") == "car").head(1).drop("t", "x", "y").join(pl.DataFrame({"t": t}), how="cross")
    car = car.with_columns(x=pl.Series(way * np.cos(COURSE)), y=pl.Series(way * np.sin(COURSE)))
    table = pl.concat([car.select(*scene().columns), scene().filter(pl.col("kind") == "ped")])
    result = imported(tmp_path, table)
    (summary,) = result.summaries
    assert (summary.near_misses, summary.left_out[TURNS]) == (1, 1)
    assert 25 < summary.left_out[BACKWARDS] < 40  # steps after the first 0.5 m of 4 m at 1 m/s
    (clip,) = described(tmp_path)
    assert [np.ptp(track.values["heading"]) < 1e-6 for track in clip.vehicles] == [True]


def test_a_window_smooths_positions_and_keeps_a_parabola(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    noise = pl.Series(rng.normal(0.0, 0.1, scene().height))
    shaken = scene().with_columns(y=pl.col("y") + noise)
    spread = [np.std(imported(tmp_path, shaken, smooth=window).table["ped_vy"].to_numpy()) for window in ("0", "1.0")]
    assert spread[1] < 0.6 * spread[0]
    brakes = scene().with_columns(x=pl.col("x") - 0.4 * pl.col("t") ** 2)
    plain, smooth = (imported(tmp_path, brakes, smooth=window).table["veh_x"] for window in ("0", "1.0"))
    assert smooth.to_numpy() == pytest.approx(plain.to_numpy(), abs=1e-9)


@pytest.mark.parametrize("rate", [10.0, 30.0])
def test_files_of_a_named_format_at_another_rate_are_read_when_it_is_said(rate: float, tmp_path: Path) -> None:
    frame = np.arange(round(6.0 * rate))
    for kind, x, y, vx, vy in (("veh", CAR, 0.0, 0.0, CAR), ("ped", 0.0, WALK, 0.0, WALK)):
        names = ("psi_est", "vel_est") if kind == "veh" else ("vx_est", "vy_est")
        rows = pl.DataFrame(
            {"id": 1, "frame": frame, "label": kind, "x_est": x * frame / rate, "y_est": y * frame / rate}
        )
        rows = rows.with_columns(pl.col("x_est") - x * 5.0, pl.col("y_est") - y * 5.0)
        rows.with_columns(pl.lit(vx).alias(names[0]), pl.lit(vy).alias(names[1])).write_csv(
            tmp_path / f"a_traj_{kind}_filtered.csv"
        )
    result = import_trajectories(tmp_path, "vci-dut", frame_rate=rate)
    assert result.table["time"].max() == pytest.approx(5.9)
    with pytest.raises(InvalidInput, match=f"they fit {rate:g} frames a second .here 23.98.|positions"):
        import_trajectories(tmp_path, "vci-dut")
    with pytest.raises(InvalidInput, match="--frame-rate: files of format cqut-pvi say their own"):
        import_trajectories(tmp_path, "cqut-pvi", frame_rate=rate)


def test_a_file_with_an_id_for_every_row_is_refused_at_once_and_one_bad_cell_costs_no_pass_for_each_road_user(
    tmp_path: Path,
) -> None:
    rows = 200_000
    table = pl.DataFrame({"id": np.arange(rows), "t": 0.0, "kind": "car", "x": 1.0, "y": 0.0})
    with pytest.raises(
        InvalidInput, match="column id has 200,000 ids in 200,000 rows, so most road users have one row"
    ):
        imported(tmp_path, table)
    cpu = {}
    for users in (250, 2000):
        k = np.arange(users * 5)
        table = pl.DataFrame({"id": k // 5, "t": 0.1 * (k % 5) + k // 5, "kind": "car", "y": 0.0})
        table = table.with_columns(kind=pl.when(pl.col("id") % 2 == 0).then(pl.lit("ped")).otherwise("kind"))
        x = np.where(k // 5 % 2 == 0, 0.1, 1.0) * (k % 5)
        x = pl.Series(x + 3.0 * (k // 5)).cast(pl.String)
        table = table.with_columns(x=pl.when(pl.int_range(pl.len()) == 7).then(pl.lit("?")).otherwise(x))
        begun = time.process_time()
        left_out = imported(tmp_path, table).summaries[0].left_out
        cpu[users] = time.process_time() - begun
        assert left_out["vehicles that cannot be read"] == 1
    assert cpu[2000] < 16.0 * max(cpu[250], 0.05)  # eight times the rows


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n",
            "a Git LFS pointer, not the file .*lfs pull",
        ),
        (b"\x1f\x8b\x08\x00", "compressed by gzip: unpack it first"),
        (b"<?xml version='1.0'?><a/>", "XML or HTML: export its tracks as CSV"),
        (b'[{"id": 1}]', "JSON: export its rows as CSV"),
        (b"PK\x03\x04", "a ZIP archive or a spreadsheet"),
        (
            b"# made by a tool\n# in 2026\nid,t,kind,x,y\n1,0,car,0,0\n",
            "begins with comments .*remove the first 2 lines",
        ),
        (b"id,t,kind,x,y\n1,0,car,0,0\n1,1,car,0,0,9\n", "line 3 has 6 values, line 1 has 5"),
        (
            b"id,t,kind,x,y\n1,2026-01-01T00:00:00,car,0,0\n",
            "column t holds dates or times of day, such as '2026-.*seconds",
        ),
    ],
)
def test_a_file_of_another_kind_is_named_without_a_librarys_options(content: bytes, said: str, tmp_path: Path) -> None:
    imported(tmp_path, scene())
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(InvalidInput, match=said) as refused:
        import_trajectories(tmp_path, "described")
    assert "schema" not in str(refused.value)


def test_a_pointer_in_place_of_a_table_or_a_bag_is_named_as_one(tmp_path: Path) -> None:
    for name, read in (("a.parquet", lambda path: read_parquet(path, "a table")), ("a.mcap", Bag)):
        (tmp_path / name).write_bytes(b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n")
        with pytest.raises(InvalidInput, match=f"{name}: a Git LFS pointer, not the file itself: run `git lfs pull`"):
            read(tmp_path / name)
    with pytest.raises(InvalidInput, match="a.mcap: a Git LFS pointer"):
        Bag(tmp_path)
