"""`vpsci_ros.simulate`: what it returns, and what it refuses."""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import vpsci_ros
from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.exam import simulation
from vpsci_ros.exam.simulation import simulate
from vpsci_ros.generate.generate_dataset import generate, part_writers
from vpsci_ros.generate.job import job_from
from vpsci_ros.nodes.example_driver import ExampleDriver
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.workers import ThisMachine
from vpsci_ros.world import load_scenario


@pytest.mark.parametrize(
    ("agents", "world"),
    [
        ("people", {}),
        ("ma_sst_ddpg", {"spawn": "paper", "episode_time": 10.0, "pedestrian_gain": 0.5}),
        ({"vehicle": "people", "pedestrian": "walker"}, {"spawn": "mixed"}),
    ],
)
def test_its_episodes_are_those_of_generate_before_the_filters_to_the_bit(
    agents: Any, world: dict[str, Any], tmp_path: Path
) -> None:
    block = simulate([6, 1], agents, 8, seed=3, first_episode=2, **world)
    names = agents if isinstance(agents, dict) else {"vehicle": agents, "pedestrian": agents}
    drivers = {f"{name}_driver": "autopilot" for name, own in names.items() if own == "walker"}
    sections = {f"{name}_policy": {"weights": own} for name, own in names.items() if own != "walker"}
    sections["world_simulator"] = {"seed": 3, "scenarios": [1, 6], **world, **drivers}
    job = job_from(Sections({**sections, "dataset": {"keep_rejected": True}}))
    start = partial(part_writers, job, 16, ThisMachine(1))
    generate(job, {1: 3, 6: 3}, tmp_path / "dataset", start, first=2, unit=4)
    generated = pl.concat(pl.read_parquet(path) for path in sorted((tmp_path / "dataset").rglob("Location*.parquet")))
    order = ["scenario", "count", "ped_id", "frame"]
    keys = generated.select("scenario", "count").unique().filter(pl.col("count") < 10)
    assert keys.height >= 6, "of two scenarios, three that pass the filters each"
    mine, theirs = (table.join(keys, on=["scenario", "count"]).sort(order) for table in (block.to_polars(), generated))
    assert mine.drop("outcome").equals(theirs)


def test_a_block_gives_each_episode_and_one_table_of_all() -> None:
    block = simulate(101, "autopilot", 3, pedestrians=2, crowd={"sizes": [0.0, 1.0]})
    assert len(block) == 3
    assert block.period == 0.05
    table = block.to_polars()
    assert table.columns == [*EPISODE_COLUMNS, "outcome"]
    for i, episode in enumerate(block):
        assert episode.key == (101, i)
        assert episode.scenario is not None
        assert episode.scenario.number == 101
        assert episode.pedestrians == 2
        rows = table.filter(count=i)
        assert rows["outcome"].unique().to_list() == [episode.outcome]
        assert np.array_equal(rows["position_x_av"].to_numpy(), np.tile(episode.x, 2).astype(np.float32))
        assert np.array_equal(rows["CurvTTC"].to_numpy(), episode.curvttc.ravel().astype(np.float32))
    assert repr(block) == "EpisodeBlock(3 episodes of scenarios 101)"
    assert re.fullmatch(r"Episode\(101:0, \w+, \d+ frames, 2 pedestrians\)", repr(block[0]))
    assert block[-1].key == block[2].key
    with pytest.raises(IndexError):
        block[3]


def test_a_bank_its_file_and_its_source_may_be_given() -> None:
    bank = load_policy("people")
    assert isinstance(bank, Bank)
    named, given = (simulate(1, agents, 4, seed=np.int64(2)) for agents in ("people", bank))
    assert named.to_polars().equals(given.to_polars())
    other = simulate(1, PolicyConfig(weights="people", people="vci"), 4, seed=2)
    assert not named.to_polars().equals(other.to_polars())


def test_the_class_of_a_driving_system_drives_the_car() -> None:
    block = simulate(load_scenario(1), {"vehicle": ExampleDriver}, 3)
    speeds = block.to_polars()["speed_av"]
    assert len(block) == 3
    assert 3.5 < speeds.max() <= 4.0, "its cruising speed"


class Breaks:
    """Drives straight on for a second."""

    def reset(self, begin: Any) -> None:
        """Begin an episode."""

    def act(self, observation: Any) -> float:
        """Return 0."""
        return 0.0 if observation.time < 1.0 else 1 / 0


def test_a_class_that_raises_ends_the_call_with_its_place_and_traceback() -> None:
    with pytest.raises(VpsciError, match=r"Breaks did not drive 1:0 at 1\.00 s: ZeroDivisionError(.|\n)*in act"):
        simulate(1, {"vehicle": Breaks}, 1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scenarios": 99}, "scenario 99: expected a number from 1 to 8"),
        ({"scenarios": []}, "scenarios: expected a number, a name, a file or a list, got []"),
        ({"scenarios": None}, "scenarios: expected a number, a name, a file or a list, got None"),
        ({"agents": "peopel"}, "agents: vehicle: unknown agent 'peopel'; did you mean people?"),
        (
            {"agents": "random"},
            "agents: vehicle: unknown agent 'random'; expected people, closed_loop, ma_sst_ddpg, autopilot",
        ),
        ({"agents": {"pedestrian": "walkr"}}, "agents: pedestrian: unknown agent 'walkr'; did you mean walker?"),
        ({"agents": {"pedestrain": "walker"}}, "agents: unknown parameter 'pedestrain'; did you mean pedestrian?"),
        ({"agents": {"pedestrian": ExampleDriver}}, "agents: pedestrian: ExampleDriver: a class drives the vehicle"),
        ({"agents": {"vehicle": Path}}, "agents: vehicle: Path: a class drives the vehicle and has reset(begin)"),
        ({"agents": "lost.safetensors"}, "weights lost.safetensors: no such file"),
        ({"agents": 3}, "agents: vehicle: expected a name, a file, a policy or a class, got 3"),
        ({"episodes": 0}, "episodes = 0 is out of range; expected 1 to"),
        ({"episodes": 2.5}, "episodes must be a whole number, got 2.5"),
        ({"seed": "a"}, "seed must be a whole number, got 'a'"),
        ({"seed": -1}, "seed = -1 is out of range"),
        ({"seed": True}, "seed must be a whole number, got True"),
        ({"spwan": "paper"}, "unknown parameter 'spwan'; did you mean spawn?"),
        ({"spawn": "papers"}, "spawn = 'papers' is unknown; expected one of right_turns, human, paper, mixed"),
        ({"kinds": {"chlid": 0.5}}, "unknown parameter 'kinds.chlid'; did you mean kinds.child?"),
        ({"vehicle_driver": "autopilot"}, "vehicle_driver: leave it out; the argument agents says who drives"),
    ],
)
def test_bad_input_is_refused_in_words(change: dict[str, Any], said: str) -> None:
    with pytest.raises(InvalidInput, match=re.escape(said)):
        simulate(**({"scenarios": 1, "agents": "autopilot", "episodes": 1} | change))


@pytest.mark.parametrize("after", [0.0, 1e6])
def test_progress_is_shown_by_work_that_takes_longer(
    after: float, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(simulation, "SHOWN_AFTER", after)
    simulate(1, "autopilot", 2)
    assert ("2 of 2 episodes" in capsys.readouterr().err) == (after == 0.0)


def test_the_package_offers_it() -> None:
    offered: Callable[..., Any] = vpsci_ros.simulate
    assert offered is simulate


def test_the_examples_of_the_pages_run_and_draw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = Path(vpsci_ros.__file__).parents[1]
    text = "".join((root / page).read_text(encoding="utf-8") for page in ("README.md", "docs/dataset.md"))
    examples = [code for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "vpsci_ros.simulate(" in code]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    for code in examples:
        exec(compile(code, "a page", "exec"), {})
    assert list(tmp_path.glob("*.png"))
