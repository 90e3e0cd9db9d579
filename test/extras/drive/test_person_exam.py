"""A person drives: by a client of the page's socket in a thread, without a browser."""

import asyncio
import json
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from page_client import said, visited

from vpsci_ros.bags.episodes import read_bag_episodes
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.view import read_exam
from vpsci_ros.extras.drive.drive_page import Page
from vpsci_ros.extras.drive.person_exam import prepare_person, run_drive
from vpsci_ros.resources import params_dir

FACTOR = 20.0  # times as fast as on a clock
Answer = Callable[[dict[str, Any]], list[dict[str, Any]] | None]


def driven(folder: Path, *answers: Answer, **world: Any) -> tuple[list[str], list[dict[str, Any]]]:
    """Let a person drive two episodes; return why not all were driven, and what the person was shown.

    :param answers: of one page after the other: what it says to a message; None: it is closed.
    """
    short = {"scenarios": [1, 5], "episode_time": 8.0, "real_time_factor": FACTOR} | world
    exam, factor = prepare_person(load(params_dir() / "drive.yaml").changed("world_simulator", short))
    seen: list[dict[str, Any]] = []

    async def visit(address: str, answer: Answer) -> None:
        async with visited(address) as connection:
            while (message := await said(connection)) is not None:
                seen.append(message)
                if (answers := answer(message)) is None or message["type"] == "end":
                    return
                for each in answers:
                    await connection.write_message(json.dumps(each))

    def visits(address: str) -> None:
        for answer in answers:
            asyncio.run(visit(address, answer))

    with closing(Page(folder)) as page:
        person = threading.Thread(target=visits, args=[page.address], daemon=True)
        person.start()
        failures = run_drive(exam, factor, folder, page)
        person.join(60.0)
        assert not person.is_alive()
        page.wait_until_left(0.0)
    return failures, seen


def at_once(message: dict[str, Any]) -> list[dict[str, Any]]:
    """Begin each episode, and press the accelerator."""
    return [{"ready": True}, {"pressed": [0, 1, 0]}] if message.get("time") == 0.0 else []


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, Any]], float]:
    """Folder of a drive to its end, what the person was shown, and how long it took [s]."""
    folder, begun = tmp_path_factory.mktemp("person") / "drive", time.monotonic()
    failures, seen = driven(folder, at_once)
    assert failures == []
    return folder, seen, time.monotonic() - begun


def test_a_person_drives_in_real_time_and_leaves_what_an_exam_leaves(
    drive: tuple[Path, list[dict[str, Any]], float],
) -> None:
    folder, seen, passed = drive
    table = pl.read_parquet(folder / "episodes.parquet")
    rows = table.filter(driver="ads").sort("scenario")
    assert rows.select("scenario", "pedestrian").rows() == [(1, "learned"), (5, "learned")]
    assert passed >= rows["duration"].sum() / FACTOR, "no faster than asked for"
    report = json.loads((folder / "report.json").read_text())
    assert report["exam"]["ads"] == "you"
    assert report["drivers"].keys() == {"ads", "autopilot"}
    assert "<h2>You, the rule-based autopilot, and their difference</h2>" in (folder / "report.html").read_text()
    assert {source.key for source in read_exam(folder, 9)} == {"ads-learned", "autopilot-learned"}
    results = [each for each in seen if each["type"] == "result"]
    assert [(each["outcome"], each["yielded"]) for each in results] == rows.select("outcome", "yielded").rows()
    assert [each["more"] for each in results] == [True, False]
    assert [each["replay"] for each in results] == [
        f"replays/{name}.html#b=autopilot" for name in ("learned-1", "learned-2")
    ]
    assert "Episode 1:0" in (folder / "replays" / "learned-1.html").read_text()


def test_what_was_shown_is_what_the_bag_holds_and_the_vehicle_went_as_the_pedal_says(
    drive: tuple[Path, list[dict[str, Any]], float],
) -> None:
    folder, seen, _ = drive
    (episode,) = read_bag_episodes(folder / "runs" / "learned" / "1" / "bag")
    frames = [each for each in seen if each["type"] == "frame"]
    first = frames[: next(k for k, each in enumerate(frames) if k and each["time"] == 0.0)]
    assert [each["x"] for each in first] == episode.x[: len(first)].tolist()
    assert [each["people"][0][0] for each in first] == episode.ped_x[0, : len(first)].tolist()
    assert len(first) == len(episode) - 1, "what ended it is shown by the replay"
    assert "curvttc" not in first[0], "a driver does not read it off the page"
    assert episode.speed[-1] > episode.speed[0] + 2.0


def test_an_episode_that_is_left_at_the_wheel_begins_again(tmp_path: Path) -> None:
    left = []

    def closes(message: dict[str, Any]) -> list[dict[str, Any]] | None:
        if left or message.get("time", 0.0) <= 1.0:
            return at_once(message)
        left.append(message)
        return None  # the page is closed

    failures, seen = driven(tmp_path / "drive", closes, at_once)
    assert failures == []
    begun = [each["name"] for each in seen if each["type"] == "episode"]
    assert begun[0] == begun[1] == "1:0"
    assert begun[-1] == "5:0"
    assert pl.read_parquet(tmp_path / "drive" / "episodes.parquet").filter(driver="ads").height == 2


def test_who_finishes_early_gets_a_report_of_what_was_driven_and_the_same_command_goes_on(tmp_path: Path) -> None:
    def finishes(message: dict[str, Any]) -> list[dict[str, Any]]:
        return [{"finish": True}] if message["type"] == "result" else at_once(message)

    failures, seen = driven(tmp_path / "drive", finishes)
    why = "default pedestrian: the ADS did not drive 5:0 to the end: at 0.00 s the person has finished (log: "
    assert [each.startswith(why) for each in failures] == [True]
    assert seen[-1] == {"type": "end", "driven": 1, "text": seen[-1]["text"]}
    kept = (tmp_path / "drive" / "runs" / "learned" / "1" / "run.json").stat().st_mtime_ns
    failures, seen = driven(tmp_path / "drive", at_once)
    assert failures == []
    assert [each["which"] for each in seen if each["type"] == "episode"] == ["episode 2 of 2"]
    assert (tmp_path / "drive" / "runs" / "learned" / "1" / "run.json").stat().st_mtime_ns == kept


def test_a_time_that_does_not_go_is_refused() -> None:
    still = load(params_dir() / "drive.yaml").changed("world_simulator", {"real_time_factor": 0.0})
    with pytest.raises(InvalidInput, match="a person drives in real time; set it to 1.0"):
        prepare_person(still)
