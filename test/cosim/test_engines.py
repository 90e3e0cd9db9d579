"""Our pedestrian in other people's engines, for real: their cars drive, ours crosses, and both react."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vpsci_ros.extras.formats.exporters import export
from vpsci_ros.policy.reaction import MARGIN
from vpsci_ros.safety import clearance

BAGS = Path(__file__).parents[2] / "bags"


def test_in_sumo_both_pedestrians_cross_before_a_car_that_sumo_stops_for_them(
    tool: Callable[..., ModuleType], tmp_path: Path
) -> None:
    """Episode 1: the car comes at 2.7 m/s, and the pedestrians walk at 0.9 m/s from 4 m before the road's middle."""
    pytest.importorskip("traci", reason="pip install 'vpsci_ros[sumo]'")
    sumo = tool("sumo_crossing", "examples")
    net = sumo.network(tmp_path)
    try:
        alone, *met = [sumo.play(net, 1, who) for who in ("nobody", "our", "SUMO's")]
        again = sumo.play(net, 1, "our")
    finally:
        sumo.traci.close()
    assert np.array_equal(again, met[0]), "to the bit"
    assert alone[:, 3].min() > 2.0, "nobody stops it"
    for rows in met:
        assert rows[:, 3].min() < 0.1, "it gives way"
        assert clearance(*rows.T[:3], *rows.T[4:6]).min() > 1.0
        assert rows[:, 5].max() > sumo.CROSSING[1] + 2.0, "across"
        assert rows[-1, 0] > sumo.CROSSING[0] + 10.0, "the car, too"
    assert np.abs(np.diff(met[0][:, 4:6], axis=0)).max() < 0.3, "ours nowhere jumps"


def test_in_highway_env_its_car_brakes_for_our_pedestrian_and_it_reacts_to_the_car(
    tool: Callable[..., ModuleType],
) -> None:
    pytest.importorskip("highway_env", reason="pip install 'vpsci_ros[highway]'")
    highway = tool("highway_crossing", "examples")
    passed, stopped = (highway.play(episode) for episode in (11, 6))
    assert passed[:, 3].min() > 4.9, "nobody stands in its lane when it passes"
    assert 0.0 <= stopped[:, 3].min() < 0.5, "IDM stops, and does not drive backwards"
    for rows in (passed, stopped):
        assert clearance(*rows.T[:3], *rows.T[4:6], length=5.0, width=2.0).min() > MARGIN
        assert rows[-1, 5] > 2.5, "across"
        assert len(rows) == 375, "25 s at 15 steps a second"
    walked = np.hypot(stopped[:, 6], stopped[:, 7])
    assert np.ptp(walked) > 0.1 * walked[0], "it reacts, here by walking slower"


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_a_commonroad_planner_drives_an_exported_scenario_before_our_pedestrian_who_reacts(
    tool: Callable[..., ModuleType], tmp_path: Path
) -> None:
    pytest.importorskip("commonroad_rp", reason="run apart by make test, with .venv/commonroad on the path")
    commonroad = tool("commonroad_crossing", "examples")
    (bag,) = BAGS.glob("LocationA_PedCross_E-W")
    export(bag, ["commonroad"], tmp_path / "out")
    (path,) = (tmp_path / "out/commonroad").glob("*.xml")
    ours, replayed = (commonroad.play(str(path), reacts, 4.0)[0] for reacts in (True, False))
    assert len(ours) == len(replayed) == 40, "the planner found a plan at each step"
    assert np.hypot(*np.diff(ours[:, :2], axis=0).T).sum() > 8.0, "it drives"
    assert np.array_equal(ours[0, 4:], replayed[0, 4:])
    assert np.hypot(*(ours[-1, 4:6] - replayed[-1, 4:6])) > 0.3, "whoever reacts is elsewhere in the end"
    assert np.abs(np.diff(ours[:, 4:6], axis=0)).max() < 0.4, "nowhere jumps"
