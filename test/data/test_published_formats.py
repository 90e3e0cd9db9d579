"""Files written by the published formats become the same near misses, whatever their names, units, axes and classes."""

import re

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.importers import IMPORTERS, import_trajectories
from vpsci_ros.data.importers.described import BLANK
from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.recordings import check_recordings

UNREADABLE = "pedestrians that cannot be read"
HEADING = 2.0  # [rad] of the car, 6 m/s from the origin; the walker comes from its right and is hit
SPEED, WALK = 6.0, 1.5  # [m/s]
SIZE = (4.2, 1.7)  # [m]


def scene(rate: float, seconds: float = 4.0) -> dict[str, pl.DataFrame]:
    """Return tables of a car, a walker and a bicycle: frame, time [s], x, y, vx, vy, heading [rad]."""
    frame = np.arange(round(seconds * rate) + 1)
    time = frame / rate
    along, across = np.array([np.cos(HEADING), np.sin(HEADING)]), np.array([-np.sin(HEADING), np.cos(HEADING)])
    meet = 18.0 * along
    tracks = {
        "car": (SPEED * time[:, None] * along, SPEED * along, HEADING),
        "walker": (meet + WALK * (time[:, None] - 3.0) * across, WALK * across, HEADING + np.pi / 2),
        "bicycle": (np.array([50.0, 50.0]) + 3.0 * time[:, None] * along, 3.0 * along, HEADING),
    }
    return {
        name: pl.DataFrame(
            {"frame": frame, "time": time, "x": xy[:, 0], "y": xy[:, 1]}
            | {"vx": np.full(len(frame), v[0]), "vy": np.full(len(frame), v[1]), "heading": np.full(len(frame), angle)}
        )
        for name, (xy, v, angle) in tracks.items()
    }


def write_levelx(folder):
    parts = scene(25.0)
    ids = {"car": 0, "walker": 1, "bicycle": 2}
    sizes = {"car": SIZE, "walker": (0.0, 0.0), "bicycle": (0.0, 0.0)}
    tracks = pl.concat(
        part.select(
            pl.lit(7).alias("recordingId"), pl.lit(ids[name]).alias("trackId"), "frame",
            pl.col("x").alias("xCenter"), pl.col("y").alias("yCenter"),
            pl.col("heading").degrees().mod(360.0).alias("heading"),
            pl.lit(sizes[name][1]).alias("width"), pl.lit(sizes[name][0]).alias("length"),
            pl.col("vx").alias("xVelocity"), pl.col("vy").alias("yVelocity"),
        )
        for name, part in parts.items()
    )  # fmt: skip
    tracks.write_csv(folder / "07_tracks.csv")
    classes = ["car", "pedestrian", "bicycle"]
    pl.DataFrame({"recordingId": 7, "trackId": [0, 1, 2], "class": classes}).write_csv(folder / "07_tracksMeta.csv")
    pl.DataFrame({"recordingId": [7], "frameRate": [25.0]}).write_csv(folder / "07_recordingMeta.csv")


def by_agent(name, part, track_id, kind, heading=None):
    columns = [pl.lit(track_id).alias("track_id"), pl.col("frame").alias("frame_id")]
    columns += [(pl.col("time") * 1000.0).alias("timestamp_ms"), pl.lit(kind).alias("agent_type"), "x", "y", "vx", "vy"]
    if heading:
        columns += [pl.col("heading").alias(heading), pl.lit(SIZE[0]).alias("length"), pl.lit(SIZE[1]).alias("width")]
    return part.select(columns)


def write_interaction(folder):
    parts = scene(10.0)
    place = folder / "DR_TEST"
    place.mkdir()
    by_agent("car", parts["car"], 1, "car", "psi_rad").write_csv(place / "vehicle_tracks_000.csv")
    by_agent("walker", parts["walker"], "P1", "pedestrian/bicycle").write_csv(place / "pedestrian_tracks_000.csv")


def write_sind(folder):
    parts = scene(29.97 / 3.0)
    place = folder / "8_02_1"
    place.mkdir()
    cars = [
        by_agent("car", parts["car"], 1, "car", "yaw_rad"),
        by_agent("b", parts["bicycle"], 2, "bicycle", "yaw_rad"),
    ]
    pl.concat(cars).write_csv(place / "Veh_smoothed_tracks.csv")
    by_agent("walker", parts["walker"], "P1", "pedestrian").write_csv(place / "Ped_smoothed_tracks.csv")


def write_argoverse2(folder):
    kinds = {"car": ("AV", "vehicle"), "walker": ("138951", "pedestrian"), "bicycle": ("138952", "cyclist")}
    rows = pl.concat(
        part.select(
            pl.lit(kinds[name][0]).alias("track_id"), pl.lit(kinds[name][1]).alias("object_type"),
            pl.col("frame").alias("timestep"), pl.col("x").alias("position_x"), pl.col("y").alias("position_y"),
            "heading", pl.col("vx").alias("velocity_x"), pl.col("vy").alias("velocity_y"),
        )
        for name, part in scene(10.0).items()
    )  # fmt: skip
    (folder / "abc").mkdir()
    rows.write_parquet(folder / "abc/scenario_abc.parquet")


def write_tgsim(folder):
    kinds = {"car": (3, SIZE), "walker": (0, (0.5, 0.5)), "bicycle": (1, (1.8, 0.6))}
    rows = pl.concat(
        part.select(
            pl.lit(number).alias("id"), "time", pl.col("x").alias("xloc_kf"), (-pl.col("y")).alias("yloc_kf"),
            pl.col("vx").alias("speed_kf_x"), (-pl.col("vy")).alias("speed_kf_y"),
            pl.lit(kinds[name][1][0]).alias("length_smoothed"), pl.lit(kinds[name][1][1]).alias("width_smoothed"),
            pl.lit(kinds[name][0]).alias("type_most_common"), pl.lit(1).alias("run_index"),
        )
        for number, (name, part) in enumerate(scene(10.0).items())
    )  # fmt: skip
    rows.write_csv(folder / "Foggy_Bottom_Trajectories.csv")


LAYOUT = """
columns: {id: who, frame: n, class: kind, x: px, y: py}
vehicles: [auto]
pedestrians: [person]
frame_rate: 20
metres: 0.05
y_down: true
length: 4.2
width: 1.7
"""


def write_described(folder):
    kinds = {"car": "auto", "walker": "person", "bicycle": "bike"}
    rows = pl.concat(
        part.select(
            pl.lit(name).alias("who"), pl.col("frame").alias("n"), pl.lit(kinds[name]).alias("kind"),
            (pl.col("x") / 0.05).alias("px"), (-pl.col("y") / 0.05).alias("py"),
        )
        for name, part in scene(20.0).items()
    )  # fmt: skip
    rows.write_csv(folder / "one.csv")
    (folder / "layout.yaml").write_text(LAYOUT)


CYCLISTS = "cyclists, which `--kinds cyclist` imports"
FORMATS = {
    "levelx": (write_levelx, CYCLISTS, ()),
    "interaction": (write_interaction, None, ()),
    "sind": (write_sind, CYCLISTS, ()),
    "argoverse2": (write_argoverse2, CYCLISTS, ("sizes of vehicles are the format's",)),
    "tgsim": (write_tgsim, CYCLISTS, ("headings are directions of motion",)),
    "described": (write_described, "road users of class bike", ("headings are directions of motion",)),
}


@pytest.mark.parametrize("name", FORMATS)
def test_a_car_and_a_walker_come_out_as_they_were_and_the_import_says_what_it_assumed(name, tmp_path):
    write, other, assumed = FORMATS[name]
    write(tmp_path)
    result = import_trajectories(tmp_path, name)
    (summary,) = result.summaries
    assert (summary.clips, summary.pairs, summary.near_misses) == (1, 1, 1)
    assert summary.left_out == ({other: 1} if other else {})
    assert set(assumed) <= set(summary.assumed)
    table = result.table
    time = table["time"].to_numpy()
    assert np.abs(np.diff(time) - 0.1).max() < 1e-9
    assert table["veh_x"].to_numpy() == pytest.approx(SPEED * time * np.cos(HEADING), abs=0.02)
    assert table["veh_y"].to_numpy() == pytest.approx(SPEED * time * np.sin(HEADING), abs=0.02)
    assert table["veh_heading"].to_numpy() == pytest.approx(HEADING, abs=1e-3)
    assert table["veh_speed"].to_numpy() == pytest.approx(SPEED, abs=0.02)
    assert table["ped_vx"].to_numpy() == pytest.approx(-WALK * np.sin(HEADING), abs=0.02)
    assert table["ped_vy"].to_numpy() == pytest.approx(WALK * np.cos(HEADING), abs=0.02)


def with_spaces(path):
    path.write_text(path.read_text().replace(",", ", "))


def in_utf_16(path):
    path.write_text(path.read_text(), encoding="utf-16")


def with_decimal_commas(path):
    path.write_text(path.read_text().replace(",", ";").replace(".", ","))


@pytest.mark.parametrize("spoil", [with_spaces, in_utf_16, with_decimal_commas])
def test_a_table_is_read_as_other_programs_leave_it(spoil, tmp_path):
    write_levelx(tmp_path)
    plain = import_trajectories(tmp_path, "levelx").table
    for path in tmp_path.glob("*.csv"):
        text = path.read_text()
        if path.name == "07_tracks.csv":  # what pandas makes of whole numbers where some are missing
            text = "\n".join(
                [text.splitlines()[0], *(re.sub(r"^7,(\d+),", r"7,\1.0,", row) for row in text.splitlines()[1:])]
            )
        path.write_text(text.replace(",pedestrian", ",Pedestrian"))
        spoil(path)
    assert import_trajectories(tmp_path, "levelx").table.equals(plain)


def test_a_format_without_one_of_the_two_kinds_says_what_there_is(tmp_path):
    write_levelx(tmp_path)
    path = tmp_path / "07_tracksMeta.csv"
    path.write_text(path.read_text().replace("pedestrian", "fussgaenger"))
    with pytest.raises(InvalidInput, match="no pedestrian in 1 clip; left out: .*road users of class fussgaenger: 1"):
        import_trajectories(tmp_path, "levelx")


def in_degrees(folder):
    """Write the described scene in longitude and latitude, at 8.68 east and 50.1 north."""
    write_described(folder)
    north, east = 111_229.0, 71_551.0  # [m] in a degree there
    x, y = pl.col("px") * 0.05, -pl.col("py") * 0.05
    pl.read_csv(folder / "one.csv").with_columns(px=8.68 + x / east, py=50.1 + y / north).write_csv(folder / "one.csv")
    text = LAYOUT.replace("metres: 0.05\ny_down: true\n", "")
    (folder / "layout.yaml").write_text(text)
    return text


def test_longitude_and_latitude_are_no_metres_and_the_projection_is_named(tmp_path):
    in_degrees(tmp_path)
    with pytest.raises(InvalidInput, match=r"within 0\.\d+ of each other: expected positions in metres.*EPSG:32632"):
        import_trajectories(tmp_path, "described")


def test_a_check_draws_near_misses_and_says_extent_speeds_and_sizes(tmp_path):
    write_levelx(tmp_path)
    said = check_recordings([tmp_path], ["levelx"], tmp_path / "check.png")
    assert (tmp_path / "check.png").stat().st_size > 10_000
    assert "median speeds: vehicles 6.00 m/s, pedestrians 2.25 m/s" in said  # of walkers at 1.5 and cyclists at 3 m/s
    assert "sizes of vehicles: 4.2 x 1.7 to 4.2 x 1.7 m" in said
    assert "1 pair, 1 near miss; 1 drawn" in said
    assert f"left out: {CYCLISTS}: 1" in said


def test_sizes_of_the_track_decide_when_it_touches(tmp_path):
    write_levelx(tmp_path)
    found = {}
    for length in (SIZE[0], SIZE[0] + 2.0):
        path = tmp_path / "07_tracks.csv"
        rows = pl.read_csv(path).with_columns(
            length=pl.when(pl.col("trackId") == 0).then(length).otherwise(pl.col("length"))
        )
        rows.write_csv(path)
        found[length] = import_trajectories(tmp_path, "levelx").table["curvttc"][0]
    assert found[SIZE[0]] - found[SIZE[0] + 2.0] == pytest.approx(1.0 / SPEED, abs=0.01)  # the nose is 1 m further on


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("frame_rate: 20", "frame_rat: 20", "frame_rate"),
        ("frame: n, ", "", "expected either frame or time"),
        ("x: px", "x: nowhere", "nowhere is missing"),
        ("vehicles: [auto]", "vehicles: auto", "vehicles: expected a list"),
        ("metres: 0.05", "metres: -1", "metres: expected a number above 0"),
    ],
)
def test_a_wrong_description_is_refused_by_key(old, new, said, tmp_path):
    write_described(tmp_path)
    (tmp_path / "layout.yaml").write_text(LAYOUT.replace(old, new))
    with pytest.raises(InvalidInput, match=said):
        import_trajectories(tmp_path, "described")


@pytest.mark.parametrize(
    ("layout", "said"),
    [
        ({"files": '"**.csv"'}, "files: expected a pattern for files in the folder|expected files .*found none"),
        ({"files": '"**"'}, "expected files .*found none|expected columns"),
        ({"files": "."}, "files: expected a pattern for files in the folder, such as .*got '.'|found none"),
        ({"files": '"../*/*.csv"'}, r"files: expected a pattern for files in the folder, .*got '\.\./"),
        ({"files": '"a\\0.csv"'}, "files: expected a pattern for files in the folder|found none"),
        ({"clip": "runn"}, "column runn is missing; it has who, n, kind, px, py"),
    ],
)
def test_a_pattern_or_a_column_that_names_nothing_is_refused(layout, said, tmp_path):
    (tmp_path / "d").mkdir()
    write_described(tmp_path / "d")
    (tmp_path / "d" / "layout.yaml").write_text(LAYOUT + "".join(f"{key}: {value}\n" for key, value in layout.items()))
    with pytest.raises(InvalidInput, match=said):
        import_trajectories(tmp_path / "d", "described")


def test_rows_without_the_name_of_a_clip_are_left_out_and_counted(tmp_path):
    write_described(tmp_path)
    rows = pl.read_csv(tmp_path / "one.csv")
    late = pl.when(pl.col("n") >= 20).then(pl.lit("late"))
    rows.with_columns(run=late).write_csv(tmp_path / "one.csv")
    (tmp_path / "layout.yaml").write_text(LAYOUT + "clip: run\n")
    (clip,) = IMPORTERS.find("described").read(tmp_path)
    assert (clip.name, clip.left_out[BLANK]) == ("one/late", 3 * 20)  # of the car, the walker and the bicycle
    assert clip.vehicles[0].first == 10  # 1 s
    rows.with_columns(run=pl.lit(None, pl.String)).write_csv(tmp_path / "one.csv")
    with pytest.raises(InvalidInput, match="column run: expected the name of a clip in each row, got none"):
        import_trajectories(tmp_path, "described")


def test_a_first_line_without_end_is_refused_before_it_is_taken_apart(tmp_path):
    write_described(tmp_path)
    (tmp_path / "one.csv").write_text("a," * 100_000 + "\n1\n")
    with pytest.raises(InvalidInput, match=r"one.csv: its first line has 0.2 MB; expected a line of columns, of at m"):
        import_trajectories(tmp_path, "described")


def with_compass(folder, **layout):
    """Write the described scene with semicolons, speeds and headings in degrees clockwise from north."""
    write_described(folder)
    auto = pl.col("kind") == "auto"
    yaw, speed = pl.when(auto).then(90.0 - np.degrees(HEADING)), pl.when(auto).then(SPEED / 0.05)
    rows = pl.read_csv(folder / "one.csv").with_columns(yaw=yaw, v=speed)
    rows.write_csv(folder / "one.csv", separator=";")
    columns = "{id: who, frame: n, class: kind, x: px, y: py, heading: yaw, speed: v}"
    units = {"units": "{angle: deg}", "heading": "clockwise from north"}
    given = {"delimiter": '";"', "columns": columns} | units | layout
    text = LAYOUT.replace("columns: {id: who, frame: n, class: kind, x: px, y: py}", "")
    (folder / "layout.yaml").write_text(text + "".join(f"{key}: {value}\n" for key, value in given.items()))


def test_a_delimiter_a_compass_and_a_speed_alone_can_be_described(tmp_path):
    with_compass(tmp_path)
    result = import_trajectories(tmp_path, "described")
    assert result.table["veh_heading"].to_numpy() == pytest.approx(HEADING, abs=1e-6)
    assert result.table["veh_speed"].to_numpy() == pytest.approx(SPEED, abs=1e-6)
    assert result.table["ped_vy"].to_numpy() == pytest.approx(WALK * np.cos(HEADING), abs=0.02)
    assert result.summaries[0].assumed[:1] == ("velocities of pedestrians are slopes of positions over 0.4 s",)


@pytest.mark.parametrize(
    ("layout", "said"),
    [
        ({"heading": "[]"}, "heading: expected from x to y, counter-clockwise from x, .*got \\[\\]"),
        ({"compass": "true"}, "compass: is written as `heading: clockwise from north`"),
        ({"delimiter": '"tab"'}, "delimiter: expected one character such as ';', got 'tab'"),
    ],
)
def test_a_value_that_a_key_cannot_have_is_refused_with_those_it_can(layout, said, tmp_path):
    with_compass(tmp_path, **layout)
    with pytest.raises(InvalidInput, match=said):
        import_trajectories(tmp_path, "described")


def damaged(folder, change):
    """Write the described scene with a second walker, whose rows are changed."""
    write_described(folder)
    rows = pl.read_csv(folder / "one.csv", infer_schema=False)
    other = rows.filter(pl.col("who") == "walker").with_columns(who=pl.lit("zoe"))
    pl.concat([rows, other.with_columns(**change)]).write_csv(folder / "one.csv")


@pytest.mark.parametrize(
    "change",
    [
        {"px": pl.when(pl.int_range(pl.len()) == 3).then(pl.lit("?")).otherwise("px")},
        {"n": pl.when(pl.int_range(pl.len()) == 3).then(pl.lit("2")).otherwise("n")},
    ],
)
def test_a_described_road_user_that_cannot_be_read_is_left_out_and_counted(change, tmp_path):
    damaged(tmp_path, change)
    (summary,) = import_trajectories(tmp_path, "described").summaries
    assert (summary.near_misses, summary.left_out[UNREADABLE]) == (1, 1)
    assert re.search(r"one.csv: line \d+", summary.checks[UNREADABLE].example)
