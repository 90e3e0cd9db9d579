import numpy as np
import pytest

from vpsci_ros.learning.assembly import STALE, HistoryAssembler
from vpsci_ros.learning.transitions import TransitionBuilder, usable
from vpsci_ros.world import COLLISION, ENDED, GOAL, World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.observation import STEP
from vpsci_ros.world.tick import Actions
from vpsci_ros.world.transition import TRANSITION

PAPER, SCENARIOS = WorldConfig(spawn="paper", release_time=0.0), load_scenarios([1, 2, 5, 7])


@pytest.fixture(scope="module")
def run():
    """Sixteen episodes under constant braking: all transitions, every tick's state, and what made them."""
    world = World(PAPER, SCENARIOS, [(s, e) for e in range(4) for s in (1, 2, 5, 7)], 8, 3)
    builder, made, ticks = TransitionBuilder(PAPER, SCENARIOS), [], []
    loop, action = Loop(world), np.tile([-1.0, 0.2], (8, 1))
    while not world.done:
        step = loop.step(Actions(vehicle=action, pedestrian=-action))
        made.append(builder.observe(step, 3, 4))
        ticks.append(step)
    return np.concatenate([rows for rows, _ in made]), ticks, builder, [h for _, whole in made for h in whole]


def test_histories_in_process_are_those_that_the_transitions_make(run):
    rows, _, _, histories = run
    again = HistoryAssembler().add(rows)
    assert len(again) == len(histories) > 5
    assert all(np.array_equal(mine, theirs) for mine, theirs in zip(histories, again, strict=True))


def test_a_history_is_an_episode_from_its_first_hand_over_to_its_end_with_every_policy_frame(run):
    rows, ticks, _, histories = run
    acted, begun, frames, ended = {}, set(), {}, {}
    for step in ticks:
        for i, record in enumerate(step.tick.state):
            key = int(record["scenario"]), int(record["episode"])
            if step.assessment.acting[i]:
                begun.add(key)
                acted[key] = acted.get(key, 0) + 1
            if key in begun and step.tick.policy_frame[i]:
                frames[key] = frames.get(key, 0) + 1
            if key in begun and record["status"] == ENDED:
                ended[key] = int(record["outcome"])
    made = {(int(h["scenario"][0]), int(h["episode"][0])): h for h in histories}
    assert set(made) == set(ended)
    assert len(histories) == len(made) > 5, "one history an episode"
    for key, whole in made.items():
        assert whole["step"].tolist() == list(range(frames[key]))
        assert whole["acting"].sum() == acted[key]
        assert whole["last"].tolist() == [0] * (len(whole) - 1) + [1]
        assert whole["collision"][-1] == (ended[key] == COLLISION)
        assert whole["terminal"][-1] == (ended[key] in (COLLISION, GOAL))
    assert any(0 < h["acting"].sum() < len(h) for h in histories), "the rule-based pair drives in between"
    assert len(rows) >= sum(map(len, histories))


def test_the_vehicle_brakes_as_requested_in_the_frame_of_the_step(run):
    """-1 m/s2 for 0.1 s by (20): the next speed is 0.1 m/s lower, along the lane."""
    *_, histories = run
    for whole in histories:
        speed, policies = whole["vehicle_observation"][:, 0], whole["acting"][:-1] != 0
        before, after = speed[:-1][policies], speed[1:][policies]
        np.testing.assert_allclose(after[before > 1.0], before[before > 1.0] - 0.1, atol=2e-3)


def test_what_the_rule_based_pair_did_is_the_acceleration_that_its_motion_shows(run):
    *_, histories = run
    seen = 0
    for whole in histories:
        speed, driven = whole["vehicle_observation"][:, 0].astype(float), whole["acting"][:-1] == 0
        straight = driven & (np.abs(whole["vehicle_action"][:-1, 1]) < 1e-3)
        gained = np.diff(speed)[straight] / STEP
        np.testing.assert_allclose(whole["vehicle_action"][:-1, 0][straight], gained, atol=1e-3)
        seen += int(straight.sum())
    assert seen > 20


def history(episode, steps, first_number=0):
    rows = np.zeros(steps, TRANSITION)
    rows["number"] = first_number + np.arange(steps)
    rows["scenario"], rows["episode"], rows["step"] = 1, episode, np.arange(steps)
    rows["vehicle_observation"][:, 0], rows["next_vehicle_observation"][:, 0] = (
        np.arange(steps),
        np.arange(1, steps + 1),
    )
    rows["acting"], rows["last"][-1] = 1, 1
    return rows


def test_a_history_in_which_the_policies_do_not_act_at_first_is_refused():
    rows = history(1, 3)
    rows["acting"][:2] = 0
    assert usable(rows).tolist() == [False, True, True]
    assembler = HistoryAssembler()
    assert assembler.add(rows) == []
    assert (assembler.refused, assembler.dropped) == (1, 2)


def test_a_lost_transition_is_counted_and_its_history_dropped():
    rows = np.concatenate([history(1, 5), history(2, 3, first_number=5)])
    assembler = HistoryAssembler()
    finished = assembler.add(np.delete(rows, 2))
    assert assembler.lost == 1
    assert [len(h) for h in finished] == [3]
    assert assembler.dropped == 4  # the other rows of the first history


def test_a_history_whose_last_row_was_lost_is_dropped_once_nothing_can_end_it():
    assembler = HistoryAssembler()
    assembler.add(history(1, 5)[:4])
    assembler.add(history(2, 3, first_number=5))
    assert (assembler.lost, assembler.dropped) == (1, 0)
    assembler.add(history(3, 1, first_number=STALE + 5))
    assert assembler.dropped == 4


@pytest.mark.parametrize(
    ("name", "value"), [("vehicle_observation", np.nan), ("next_vehicle_observation", 1e30), ("collision", 2)]
)
def test_a_transition_that_would_spoil_every_weight_is_refused_and_its_history_dropped(run, name, value):
    first = run[0][run[0]["scenario"] == 1]
    rows = first[first["episode"] == first["episode"][0]].copy()
    rows["number"] = np.arange(len(rows))
    rows[name][1] = value
    assert usable(rows).tolist() == [True, False] + [True] * (len(rows) - 2)
    assembler = HistoryAssembler()
    finished = assembler.add(rows)
    assert assembler.refused == 1
    assert assembler.consumed == len(rows)
    assert sum(map(len, finished)) + assembler.refused + assembler.dropped == len(rows)
    assert all(np.isfinite(made["vehicle_observation"]).all() for made in finished)
