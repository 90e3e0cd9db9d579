"""What is packed is unpacked again within the step of each quantity, whatever its size; nothing known is lost."""

import base64

import numpy as np
from view.motion import episode

from vpsci_ros.view.view_page import FIELDS, FINEST, INFINITE, UNKNOWN, Shown, Source, ground, grounds, packed
from vpsci_ros.world import Scenario, load_scenario


def source(values: np.ndarray, scenario: Scenario | int = 1, others: np.ndarray | None = None) -> Source:
    shown = Shown(episode(values, scenario=scenario, others=others), "both", ("m",))
    return Source("key", "title", 0.1, [shown], 1)


def unpacked(row: dict) -> tuple[np.ndarray, np.ndarray]:
    """Return codes and values as the page reads them."""
    codes = np.frombuffer(base64.b64decode(row["frames"]), "<i2").reshape(-1, len(FIELDS))
    return codes, codes * np.array(row["steps"])


def motion(n: int = 50) -> np.ndarray:
    rng = np.random.default_rng(5)
    values = rng.normal(0.0, 3.0, (n, len(FIELDS)))
    values[:, 4] *= 0.03
    values[:, 9] = np.abs(values[:, 9])
    values[:, 10] = np.arange(n) % 2
    return values


def test_every_quantity_comes_back_within_half_its_step() -> None:
    values = motion()
    values[:, (0, 5)] += 4_000_000.0  # a map far from its origin
    row = packed(source(values))
    _, back = unpacked(row)
    middle = row["episodes"][0]["middle"]
    back[:, (0, 5)] += middle[0]
    back[:, (1, 6)] += middle[1]
    turns = 2.0 * np.pi * np.round(values[0, 2] / (2.0 * np.pi))
    back[:, 2] += turns
    assert (np.abs(back - values).max(axis=0) <= 0.5001 * np.array(row["steps"])).all()
    assert row["steps"] == [FINEST[name] for name in FIELDS]


def test_infinite_and_unknown_times_stay_what_they_are() -> None:
    values = motion()
    values[3:5, 9] = np.inf, np.nan
    codes, _ = unpacked(packed(source(values)))
    assert codes[3:5, 9].tolist() == [INFINITE, UNKNOWN]


def test_an_episode_keeps_its_least_time_its_onset_and_its_marks() -> None:
    values = motion()
    values[:, 9] = np.r_[np.full(20, np.inf), np.full(29, 4.5), 1.25]
    row = packed(source(values))
    (episode,) = row["episodes"]
    assert (episode["least"], episode["onset"], row["marks"], episode["marks"]) == (1.25, 20, ["m"], [0])


def test_the_ground_of_a_scenario_of_the_package_is_the_pages_and_that_of_ones_own_its_sources() -> None:
    own, paper = load_scenario(103), load_scenario(1)
    sources = [source(motion(), paper), source(motion(), own), source(motion(), 0)]
    assert grounds(sources, shipped=True) == {1: ground(paper)}
    assert [packed(each)["grounds"] for each in sources] == [{}, {103: ground(own)}, {}]
    assert len(ground(paper)["crosswalk"]) >= 4
    assert ground(paper)["lane_width"] > 2.0


def test_further_pedestrians_come_back_within_half_a_step_and_cost_nothing_where_there_are_none() -> None:
    others = np.random.default_rng(3).normal(0.0, 2.0, (2, 50, 4))
    alone, row = source(motion()), packed(source(motion(), others=others))
    assert row["episodes"][0]["others"] == 2
    codes = np.frombuffer(base64.b64decode(row["others"]), "<i2").reshape(2, 50, 4)
    back = codes * np.array(row["other_steps"]) + [*row["episodes"][0]["middle"], 0.0, 0.0]
    assert (np.abs(back - others) <= 0.5001 * np.array(row["other_steps"])).all()
    assert "others" not in packed(alone)
    assert "others" not in packed(alone)["episodes"][0]
