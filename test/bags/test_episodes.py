"""Episodes of a bag: found by their records, chosen by number or CurvTTC, and read without the rest."""

from pathlib import Path

import numpy as np
import pytest
from bags.copied import received

from vpsci_ros.bags.episodes import (
    BagEpisode,
    EpisodeLog,
    bag_episodes,
    choose,
)
from vpsci_ros.bags.reader import Bag
from vpsci_ros.data.episode import Listed
from vpsci_ros.world.state import EVENT, FINISHED, STARTED


def episode(scenario: int, number: int, outcome: str = "goal", least: float = 2.0) -> BagEpisode:
    return BagEpisode(Listed.simulated((scenario, number), None, outcome, least), 0, 0, 10, 0, 500)


EPISODES = [episode(1, 3), episode(1, 7, "collision", 0.0), episode(6, 3, "timeout", np.inf), episode(6, 8, least=1.2)]


def names(chosen: list[BagEpisode]) -> list[str]:
    return [one.listed.name for one in chosen]


@pytest.mark.parametrize(
    ("conditions", "expected"),
    [
        (("3",), ["1:3", "6:3"]),
        (("6:3",), ["6:3"]),
        (("3,7-9",), ["1:3", "1:7", "6:3", "6:8"]),
        (("", 1.5), ["1:7", "6:8"]),
        (("6:1-9", 1.5), ["6:8"]),
    ],
)
def test_episodes_are_chosen_by_number_and_curvttc(conditions: tuple, expected: list[str]) -> None:
    assert names(choose(EPISODES, *conditions)) == expected


def test_events_make_episodes_and_one_whose_beginning_was_not_seen_is_left_out() -> None:
    log, events = EpisodeLog(), np.zeros(3, EVENT)
    events["kind"], events["slot"] = [STARTED, FINISHED, FINISHED], [1, 0, 1]
    events["scenario"], events["episode"] = 2, [9, 8, 9]
    events["outcome"], events["least_curvttc"] = [0, 1, 2], [np.inf, 0.0, 1.25]
    assert log.add(4, 200, events[:1], "bag_0.mcap") == []
    assert log.unfinished == 1
    (ended,) = log.add(30, 1500, events[1:], "bag_1.mcap")
    listed = Listed.simulated((2, 9), None, "goal", 1.25)
    assert ended == BagEpisode(listed, 1, 4, 30, 200, 1500, "bag_0.mcap", "bag_1.mcap")
    assert log.unfinished == 0


def test_the_episodes_of_a_bag_are_known_without_reading_a_message(
    own_bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = Bag(own_bag)
    monkeypatch.setattr(bag, "messages", None)
    assert names(bag_episodes(bag)) == ["1:0", "6:4", "1:2"]


def test_records_agree_with_what_the_states_tell(own_bag: Path, foreign: Path) -> None:
    recorded = bag_episodes(Bag(own_bag))
    for one, decoded in zip(recorded, bag_episodes(Bag(foreign)), strict=True):
        assert one.listed.name == decoded.listed.name
        for name in ("scenario", "episode", "start_tick", "end_tick", "outcome"):
            assert one.values()[name] == decoded.values()[name], name
        for name in ("start_time", "end_time"):
            assert received(getattr(one, name)) == getattr(decoded, name), name
        assert one.listed.least_curvttc == pytest.approx(decoded.listed.least_curvttc)
