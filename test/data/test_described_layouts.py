"""What layout.yaml can describe: no header, boxes, lost rows, both in one row, and a source's name."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from vpsci_ros.data.importers import ImportResult, import_folders, import_trajectories, imported_clips
from vpsci_ros.data.importers.described import LOST, described
from vpsci_ros.data.importers.layout_file import KEYS, read_layout_file
from vpsci_ros.data.importers.pairs import near_misses_of
from vpsci_ros.data.near_misses import check_near_misses, write_near_misses
from vpsci_ros.data.parquet import read_metadata
from vpsci_ros.errors import InvalidInput

PLAIN = {
    "columns": "{id: who, frame: n, class: kind, x: px, y: py}",
    "vehicles": "[car]",
    "pedestrians": "[person]",
    "frame_rate": "10",
}
MEASURED = ["time", "veh_x", "veh_y", "veh_heading", "veh_speed", "ped_x", "ped_y", "ped_vx", "ped_vy", "curvttc"]


def rows() -> pl.DataFrame:
    """Return a car along x at 6 m/s, and somebody who crosses its path when it comes, at 10 Hz."""
    n = np.arange(81)
    car = pl.DataFrame({"n": n, "who": 1, "kind": "car", "px": 0.6 * n - 24.0, "py": 0.0})
    person = pl.DataFrame({"n": n, "who": 2, "kind": "person", "px": 6.0, "py": 0.13 * n - 6.5})
    return pl.concat([car, person])


def write(folder: Path, table: pl.DataFrame, *, name: str = "a.csv", names: bool = True, **layout: str) -> None:
    """Write a table and its layout: `PLAIN`, and other keys; None: not this one."""
    folder.mkdir(parents=True, exist_ok=True)
    table.write_csv(folder / name, include_header=names)
    keys = {key: value for key, value in (PLAIN | layout).items() if value is not None}
    (folder / "layout.yaml").write_text("".join(f"{key}: {value}\n" for key, value in keys.items()))


def imported(folder: Path, table: pl.DataFrame, **layout: str) -> ImportResult:
    write(folder, table, **layout)
    return import_trajectories(folder, "described")


@pytest.fixture
def plain(tmp_path: Path) -> pl.DataFrame:
    result = imported(tmp_path / "plain", rows())
    assert result.summaries[0].near_misses == 1
    return result.table.select(MEASURED)


BY_NUMBER = {"header": "false", "columns": "{frame: 1, id: 2, class: 3, x: 4, y: 5}"}


def test_columns_of_a_file_without_a_header_go_by_number(plain: pl.DataFrame, tmp_path: Path) -> None:
    write(tmp_path, rows(), names=False, **BY_NUMBER)
    assert_frame_equal(import_trajectories(tmp_path, "described").table.select(MEASURED), plain, check_exact=True)
    write(tmp_path, rows().with_columns(run=pl.lit("r")), names=False, clip="6", **BY_NUMBER)
    assert import_trajectories(tmp_path, "described").table["clip"].unique().to_list() == ["a/r"]


@pytest.mark.parametrize(
    ("layout", "said"),
    [
        ({"columns": PLAIN["columns"]}, "columns: without a header expected numbers of columns, 1 for the first, got"),
        ({"columns": "{frame: 0, id: 2, class: 3, x: 4, y: 5}"}, "expected numbers of columns, 1 for the first"),
        ({"columns": "{frame: 1, id: 2, class: 3, x: 4, y: 9}"}, "column 9 is missing; it has 1, 2, 3, 4, 5"),
        ({"header": "none"}, "header: expected true or false, got 'none'"),
    ],
)
def test_a_column_without_a_number_is_refused_where_there_is_no_header(
    layout: dict[str, str], said: str, tmp_path: Path
) -> None:
    write(tmp_path, rows(), names=False, **(BY_NUMBER | layout))
    with pytest.raises(InvalidInput, match=said):
        import_trajectories(tmp_path, "described")


def test_a_bad_cell_is_named_by_its_line_in_the_file_whatever_precedes_it(tmp_path: Path) -> None:
    for header, line in ((True, 100), (False, 99)):  # the first line is the first row, without a header
        bad = rows().with_columns(px=pl.col("px").cast(pl.String), run=pl.col("who"))
        bad = bad.with_columns(px=pl.when(pl.int_range(pl.len()) == 98).then(pl.lit("?")).otherwise("px"))
        numbers = {} if header else BY_NUMBER
        write(tmp_path, bad, names=header, **numbers)
        with pytest.raises(InvalidInput, match=f"a.csv: line {line}, column .*: expected a finite number, got .?"):
            import_trajectories(tmp_path, "described")


BOX = "{id: who, frame: n, class: kind, x_min: x0, y_min: y0, x_max: x1, y_max: y1}"


def test_of_boxes_the_centres_count(plain: pl.DataFrame, tmp_path: Path) -> None:
    side = pl.when(pl.col("kind") == "car").then(4.0).otherwise(1.0)
    boxes = rows().with_columns(x0=pl.col("px") - side, x1=pl.col("px") + side, y0=pl.col("py") - 0.5 * side)
    boxes = boxes.with_columns(y1=pl.col("py") + 0.5 * side).drop("px", "py")
    table = imported(tmp_path / "up", boxes, columns=BOX).table.select(MEASURED)
    assert_frame_equal(table, plain, abs_tol=1e-9)
    down = boxes.with_columns(-pl.col("y0", "y1"))
    table = imported(tmp_path / "down", down, columns=BOX, y_down="true").table.select(MEASURED)
    assert_frame_equal(table, plain, abs_tol=1e-9)
    for columns, said in (
        (BOX.replace(", y_max: y1", ""), "columns: y_max missing; it has"),
        (BOX.replace("x_min: x0", "x: px, x_min: x0"), "columns: expected either x and y or x_min"),
        ("{id: who, frame: n, class: kind, x: px}", r"columns: y missing; it has id"),
    ):
        with pytest.raises(InvalidInput, match=said):
            imported(tmp_path / "half", boxes, columns=columns)


@pytest.mark.parametrize(("lost", "seen"), [("1", "0"), ("true", "false"), ("True", ""), ("1.0", "0.0")])
def test_rows_that_are_marked_as_lost_do_not_count(lost: str, seen: str, plain: pl.DataFrame, tmp_path: Path) -> None:
    late = rows().filter(pl.col("kind") == "person").with_columns(n=pl.col("n") + 81, px=pl.lit(-1000.0))
    marked = pl.concat([rows().with_columns(gone=pl.lit(seen)), late.with_columns(gone=pl.lit(lost))])
    columns = PLAIN["columns"].replace("y: py", "y: py, lost: gone")
    result = imported(tmp_path, marked, columns=columns)
    assert_frame_equal(result.table.select(MEASURED), plain, check_exact=True)
    assert result.summaries[0].left_out == {LOST: 81}
    with pytest.raises(InvalidInput, match="line 164, column gone: expected 0 or 1, true or false, got 'perhaps'"):
        imported(tmp_path, marked.with_columns(gone=pl.col("gone").replace(lost, "perhaps")), columns=columns)


PAIRS = {
    "columns": "{frame: n}",
    "vehicle": "{id: car, x: car_x, y: car_y}",
    "pedestrian": "{id: walker, x: walker_x, y: walker_y}",
    "vehicles": None,
    "pedestrians": None,
}


def in_one_row() -> pl.DataFrame:
    """Return the same two, a step in a row."""
    sides = [rows().filter(pl.col("kind") == kind).drop("kind") for kind in ("car", "person")]
    names = [{"who": who, "px": f"{who}_x", "py": f"{who}_y"} for who in ("car", "walker")]
    car, walker = (side.rename(own) for side, own in zip(sides, names, strict=True))
    return car.join(walker, on="n")


def test_a_row_may_hold_a_car_and_a_pedestrian(plain: pl.DataFrame, tmp_path: Path) -> None:
    result = imported(tmp_path / "one", in_one_row(), **PAIRS)
    assert_frame_equal(result.table.select(MEASURED), plain, check_exact=True)
    assert result.table.select("veh_name", "ped_name").row(0) == ("1", "2")
    far = in_one_row().with_columns(walker=pl.lit(3), walker_x=pl.lit(90.0))  # the car again, and somebody far away
    result = imported(tmp_path / "two", pl.concat([in_one_row(), far]), **PAIRS)
    assert (result.summaries[0].vehicles, result.summaries[0].pedestrians, result.summaries[0].pairs) == (1, 2, 2)
    late = in_one_row().with_columns(
        pl.when(pl.col("n") >= 10).then(pl.col("walker", "walker_x", "walker_y"))
    )  # comes after 1 s: its cells are empty before
    assert imported(tmp_path / "late", late, **PAIRS).table["time"].min() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("layout", "said"),
    [
        ({"pedestrian": None}, "vehicle: expected columns of a row that holds both .* and both keys"),
        ({"vehicles": "[car]"}, "vehicle: expected either it or class, vehicles and pedestrians"),
        ({"vehicle": "{id: car, x: car_x}"}, "vehicle: y missing; it has frame, id, x"),
        ({"vehicle": "{id: car, x: car_x, y: nowhere}"}, "column nowhere is missing; it has"),
    ],
)
def test_a_row_of_both_that_is_half_described_is_refused(layout: dict[str, str], said: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=said):
        imported(tmp_path, in_one_row(), **(PAIRS | layout))


def test_a_layout_names_its_source(tmp_path: Path) -> None:
    result = imported(tmp_path / "a", rows(), source="my_corner")
    assert result.table["source"].unique().to_list() == ["my_corner"]
    assert [*result.metadata["sources"]] == ["my_corner"]
    write(tmp_path / "b", rows(), name="b.csv", source="elsewhere")
    both = import_folders([tmp_path / "a", tmp_path / "b"], ["described"])
    assert [summary.source for summary in both.summaries] == ["my_corner", "elsewhere"]
    with pytest.raises(InvalidInput, match="layout.yaml: source: 'my/corner': expected letters, digits, _ and -"):
        imported(tmp_path / "c", rows(), source="my/corner")


def test_the_size_of_a_layout_is_that_of_its_vehicles_and_is_stored_with_the_table(tmp_path: Path) -> None:
    result = imported(tmp_path, rows(), source="my_corner", length="5.1", width="2.0")
    assert result.table.select("veh_length", "veh_width").unique().rows() == [(5.1, 2.0)]
    write_near_misses(result.table, tmp_path / "near.parquet", result.metadata)
    stored = read_metadata(tmp_path / "near.parquet")["sources"]["my_corner"]
    assert (stored["vehicle_length"], stored["vehicle_width"]) == (5.1, 2.0)


def test_clips_of_one_folder_have_one_source_and_one_size(tmp_path: Path) -> None:
    write(tmp_path, rows())
    (clip,) = described(tmp_path)
    for other in (replace(clip, source="elsewhere"), replace(clip, size=(5.1, 2.0))):
        with pytest.raises(InvalidInput, match=r"clip b: expected source here and vehicles of \(4.5, 1.8\) m, .* got"):
            near_misses_of("here", [clip, replace(other, name="b")], length=4.5, width=1.8)


@pytest.mark.parametrize(
    ("layout", "said"),
    [
        (
            {"vehicles": "[car, buss]"},
            r"vehicles: none of buss occurs in column kind, which has 'car' \(1 road users\)",
        ),
        ({"pedestrians": "[person, Child]"}, "pedestrians: none of child occurs in column kind"),
    ],
)
def test_a_misspelt_class_is_refused_though_another_one_occurs(
    layout: dict[str, str], said: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=said):
        imported(tmp_path, rows(), **layout)


ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("source", "folder", "vehicles", "least"), [("hc", "hc", 40, 150), ("taf-bw", "taf_bw/recorded_trackfiles", 130, 5)]
)
def test_the_example_layouts_read_the_published_recordings(
    source: str, folder: str, vehicles: int, least: int, real_data: Path, tmp_path: Path
) -> None:
    if not (real_data / folder).is_dir():
        pytest.skip(f"no {folder} in {real_data}")
    shutil.copytree(real_data / folder, tmp_path / "r")
    shutil.copy(ROOT / "examples/layouts" / f"{source}.yaml", tmp_path / "r/layout.yaml")
    ((clips, result),) = imported_clips([tmp_path / "r"], ["described"])
    check_near_misses(result.table, source)
    summary = result.summaries[0]
    assert summary.source == source
    assert summary.vehicles >= vehicles
    assert summary.near_misses >= least
    people = [track.values for clip in clips for track in clip.pedestrians]
    speed = np.concatenate([np.hypot(one["vx"], one["vy"]) for one in people])
    assert 1.0 < np.median(speed[speed > 0.5]) < 1.8  # people walk: the units of time and place are right


def test_the_commented_example_is_a_layout_and_shows_every_key(tmp_path: Path) -> None:
    text = (ROOT / "examples/layouts/layout.yaml").read_text()
    assert set(re.findall(r"^(?:# )?(\w+): ", text, re.MULTILINE)) | {"time_unit", "width", "scooters"} == set(KEYS)
    assert read_layout_file(ROOT / "examples/layouts/layout.yaml").source == "my_corner"
    pairs = tmp_path / "pairs.yaml"
    pairs.write_text("\n".join(re.findall(r"^# ((?:columns|vehicle|pedestrian): .*)$", text, re.MULTILINE)))
    assert len(read_layout_file(pairs).layouts) == 2
