"""Encounters timed to the system under test: where pedestrians begin, who becomes critical, and what is not met."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.exam.conduct import timed_runs
from vpsci_ros.exam.exam import ALONE, Exam, prepare
from vpsci_ros.exam.measures import episode_table
from vpsci_ros.exam.recorded_people import recorded_people
from vpsci_ros.exam.timing import BOUND, TIMING, Timing, not_met, read_timing, sentence, summary
from vpsci_ros.resources import params_dir
from vpsci_ros.world import World, WorldConfig, load_scenarios

DRIVERS = """
class Blind:
    speed, faster = 8.0, 0.0

    def reset(self, begin):
        pass

    def act(self, observation):
        met = any(abs(each.x - observation.vehicle.x) < 500.0 for each in observation.pedestrians)
        return min(9.0, max(-8.0, 2.0 * (self.speed + met * self.faster - observation.vehicle.speed)))


class Blind3(Blind):
    speed = 3.0


class Blind12(Blind):
    speed = 12.0


class Nearly(Blind):
    speed = 8.05


class Sly(Blind):
    speed, faster = 2.5, 8.0
"""
SCENARIOS = load_scenarios([1, 4, 101])
KEYS = [(scenario.number, number) for scenario in SCENARIOS for number in range(3)]
MOTION = ("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy")


def walks(ticks: int, head_start: float = 0.0, straight: float = 0.0, **given: object) -> np.ndarray:
    """Return the walkers' motion, float64[ticks, rows, 4]."""
    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", **given)
    starts = dict.fromkeys(KEYS, (head_start, straight))
    world, seen = World(config, SCENARIOS, KEYS, len(KEYS), 1, head_starts=starts), []
    for _ in range(ticks):
        seen.append(np.stack([world.state[name] for name in MOTION], axis=1))
        world.advance(world.now.unassessed())
    return np.array(seen)


@pytest.mark.parametrize("given", [{}, {"spawn": "human"}, {"spawn": "paper"}], ids=["right_turns", "human", "paper"])
def test_with_a_head_start_walkers_are_where_they_would_be_that_much_later_and_earlier_they_come_from_further_back(
    given: dict[str, str],
) -> None:
    drawn = walks(12, **given)
    assert np.abs(walks(4, 0.4, **given) - drawn[8:]).max() < 1e-9
    late = walks(30, -1.0, **given)
    assert np.abs(late[20:] - drawn[:10]).max() < 1e-9
    assert np.abs(late[0, :, :2] - (drawn[0, :, :2] - drawn[0, :, 2:])).max() < 1e-9, "1 s at their velocity"
    beyond = walks(1, 0.4, 0.5, **given)[0]
    assert np.abs(beyond[:, :2] - (drawn[8, :, :2] + 0.5 * drawn[8, :, 2:])).max() < 1e-9


def test_all_pedestrians_of_an_episode_have_its_head_start() -> None:
    drawn, late = (walks(24, start, pedestrians=3, spawn="paper") for start in (0.0, -1.0))
    assert np.abs(late[20] - drawn[0]).max() < 0.5, "they push each other aside on the way"
    assert np.abs(late[0, :, :2] - drawn[0, :, :2]).max() > 1.0


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, here: None) -> Path:
    (tmp_path / "drivers_of_timing.py").write_text(DRIVERS)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def exam(driver: str, *, timing: str = "own", episodes: int = 2) -> Exam:
    chosen = {"pedestrians": ["walker"], "timing": timing}
    sections = load(params_dir() / "ads_test.yaml").changed("world_simulator", {"episodes": episodes})
    return prepare(sections.changed("ads_test", chosen), ads_class=f"drivers_of_timing:{driver}")


def table(driver: str, folder: Path, **given: object):
    chosen = exam(driver, **given)
    runs, timing = timed_runs(chosen, folder, quiet=True)
    rows = episode_table(runs["walker"], runs[ALONE].episodes, driver="ads", pedestrian="walker", timing=timing)
    return rows, timing


def test_blind_drivers_of_any_speed_become_critical_and_lose_no_time(home: Path) -> None:
    for driver in ("Blind3", "Blind", "Blind12"):
        rows, _ = table(driver, home / driver)
        assert rows["critical"].mean() >= 0.9, driver
        assert rows["hurried"].drop_nans().abs().max() < 1e-9, "the same drive as alone"
        assert rows.filter(~rows["collision"])["time_lost"].abs().max() in (0.0, None)
    drawn, none = table("Blind12", home / "drawn", timing="autopilot")
    assert drawn["critical"].mean() < 0.7, "the autopilot's timing is not this driver's"
    assert none == {}


def test_a_stored_timing_is_read_again_and_computed_to_the_same_bytes(home: Path) -> None:
    _, timing = table("Blind", home / "out", episodes=1)
    before = (home / "out" / TIMING).read_bytes()
    assert read_timing(home / "out") == timing
    (home / "out" / TIMING).unlink()
    timed_runs(exam("Blind", episodes=1), home / "out", quiet=True)
    assert (home / "out" / TIMING).read_bytes() == before


def test_nearly_equal_drives_have_one_timing_and_others_each_its_own(home: Path) -> None:
    _, first = table("Blind", home / "first", episodes=1)
    found: dict[str, Timing] = {}
    for driver in ("Nearly", "Blind3"):
        _, found[driver] = timed_runs(exam(driver, episodes=1), home / driver, against=home / "first", quiet=True)
    assert all(timed.ahead == first[key].ahead for key, timed in found["Nearly"].items())
    assert {timed.of for timed in found["Nearly"].values()} == {"baseline"}
    apart = {key for key, timed in found["Blind3"].items() if timed.of == "own"}
    assert len(apart) >= 6, "of 8 scenarios"
    assert all(
        abs(timed.ahead - first[key].ahead) < BOUND for key, timed in found["Blind3"].items() if key not in apart
    )


def test_a_system_that_drives_otherwise_where_somebody_is_meets_nobody_and_does_not_pass(home: Path) -> None:
    rows, timing = table("Sly", home / "sly")
    report = {"timing": summary(timing, rows), "drivers": {"ads": {"walker": {}}}}
    (reason,) = not_met(report)
    assert "it drives otherwise where somebody is" in reason
    assert sentence(report) == "The pedestrians are timed to the system's own approach in 16 of 16 episodes."
    assert sentence({"timing": None, "drivers": {"ads": {}}}) == "The system drove no episode with a pedestrian."
    assert sentence(report | {"drivers": {"ads": {}}}) == sentence(report), "it was timed before it failed"


def test_recorded_people_come_earlier_by_the_head_start(home: Path) -> None:
    chosen = exam("Blind", episodes=1)
    world = dataclasses.replace(chosen.world, episode_time=4.0)
    given = read_near_misses("right_turns/dev"), chosen.spawns(), chosen.scenarios, world, 1
    drawn = recorded_people(*given)
    ahead = recorded_people(*given, head_starts=dict.fromkeys(drawn, (1.0, 0.5)))
    assert all(np.abs(ahead[key][:-30] - drawn[key][30:]).max() < 1e-6 for key in drawn), "30 ticks are 1.5 s"
