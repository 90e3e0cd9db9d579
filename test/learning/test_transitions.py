import itertools

import numpy as np
import pytest

from vpsci_ros.learning.assembly import STALE, HistoryAssembler
from vpsci_ros.learning.transitions import STEPS, TRANSITION, TransitionBuilder, usable
from vpsci_ros.world import COLLISION, ENDED, EPISODE, GOAL, RUNNING, World, WorldConfig, load_scenarios
from vpsci_ros.world.events import NO_EVENTS
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.tick import Actions, Step, Tick


@pytest.fixture(scope="module")
def run():
    """Sixteen episodes under constant braking: all transitions, every tick's state, and what made them."""
    world = World(
        WorldConfig(spawn="paper"), load_scenarios([1, 2, 5, 7]), [(s, e) for e in range(4) for s in (1, 2, 5, 7)], 8, 3
    )
    builder, made, ticks = TransitionBuilder(), [], []
    loop, action = Loop(world), np.tile([-1.0, 0.2], (8, 1))
    while not world.done:
        step = loop.step(Actions(vehicle=action, pedestrian=-action))
        made.append(builder.observe(step, 3, 4))
        ticks.append(step)
    return np.concatenate([tick.transitions for tick in made]), ticks, builder, [h for t in made for h in t.histories]


def test_transitions_are_numbered_without_gaps(run):
    rows, _, builder, _ = run
    assert len(rows) > 100
    assert np.array_equal(rows["number"], np.arange(len(rows)))
    assert builder.count == len(rows)


def test_there_is_one_transition_for_every_step_that_the_policies_took(run):
    rows, ticks, *_ = run
    taken = sum(int(step.assessment.acting.sum()) for step in ticks)
    assert len(rows) == taken


def test_histories_begin_at_zero_and_follow_on_without_a_gap(run):
    rows, *_ = run
    for key in {(int(r["scenario"]), int(r["episode"])) for r in rows}:
        mine = rows[(rows["scenario"] == key[0]) & (rows["episode"] == key[1])]
        assert mine["step"][0] == 0
        assert mine["last"][-1] == 1
        for before, after in itertools.pairwise(mine):
            if before["last"]:
                assert after["step"] == 0
            else:
                assert after["step"] == before["step"] + 1


def test_only_the_last_transition_of_a_history_says_what_the_step_after_sees(run):
    rows, *_ = run
    last = rows["last"] == 1
    for agent in ("vehicle", "pedestrian"):
        assert not rows[~last][f"next_{agent}_observation"].any()
        assert rows[last][f"next_{agent}_observation"].any(axis=1).all()
    assert not rows[~last]["next_curvttc"].any()


def test_histories_in_process_are_those_that_the_transitions_make(run):
    rows, _, _, histories = run
    again = HistoryAssembler().add(rows)
    assert len(again) == len(histories) > 10
    assert all(np.array_equal(mine, theirs) for mine, theirs in zip(histories, again, strict=True))


def test_a_history_may_be_longer_than_the_memory_that_it_begins_with():
    builder, action = TransitionBuilder(), np.ones((1, 2))
    for step in range(STEPS + 2):
        assert not builder.observe(acting(step, int(step > 0), step, Actions(action, action))).histories
    (whole,) = builder.observe(acting(step + 1, 1, step + 1, Actions())).histories
    assert whole["step"].tolist() == list(range(STEPS + 2))


def test_the_vehicle_brakes_as_requested_in_the_frame_of_the_step(run):
    """-1 m/s2 for 0.1 s by (20): the next speed is 0.1 m/s lower, along the lane."""
    *_, histories = run
    for speed in (whole["vehicle_observation"][:, 0] for whole in histories):
        before, after = speed[:-1], speed[1:]
        np.testing.assert_allclose(after[before > 1.0], before[before > 1.0] - 0.1, atol=2e-3)


def test_each_ended_episode_under_control_has_one_last_transition_with_its_outcome(run):
    rows, ticks, *_ = run
    ended = {}
    for state in (step.tick.state for step in ticks):
        for record in state[(state["status"] == ENDED) & (state["controlled"] != 0)]:
            ended[int(record["scenario"]), int(record["episode"])] = int(record["outcome"])
    collisions = {(int(r["scenario"]), int(r["episode"])) for r in rows[rows["collision"] == 1]}
    assert collisions == {key for key, outcome in ended.items() if outcome == COLLISION}
    terminal = {(int(r["scenario"]), int(r["episode"])) for r in rows[rows["terminal"] == 1]}
    assert terminal == {key for key, outcome in ended.items() if outcome in (COLLISION, GOAL)}


def test_versions_of_the_policies_are_stamped(run):
    rows, *_ = run
    assert (rows["vehicle_policy_version"] == 3).all()
    assert (rows["pedestrian_policy_version"] == 4).all()


def one_slot(frame, controlled, step):
    state = np.zeros(1, EPISODE)
    state["status"], state["frame"], state["scenario"], state["episode"] = RUNNING, frame, 1, 9
    state["controlled"], state["step"], state["vehicle_speed"] = controlled, step, 4.0
    return state


def acting(frame, controlled, step, actions):
    yes = np.ones(1, bool)
    tick = Tick(number=frame, state=one_slot(frame, controlled, step), policy_frame=yes)
    return Step(tick, tick.assessed(np.ones(1), np.ones(1), yes), actions, NO_EVENTS)


def test_a_missing_answer_ends_the_history():
    builder, action = TransitionBuilder(), np.ones((1, 2))

    def observe(*which):
        return builder.observe(acting(*which)).transitions

    assert len(observe(0, 0, 0, Actions(action, action))) == 0
    rows = observe(2, 1, 1, Actions(pedestrian=action))
    assert rows["last"].tolist() == [1]
    assert rows["terminal"].tolist() == [0]
    assert len(observe(4, 1, 2, Actions(action, action))) == 0


def driven_by_the_autopilot(frame, status=RUNNING, outcome=0, goals=(0, 0)):
    state = one_slot(frame, 0, 0)
    state["status"], state["outcome"] = status, outcome
    state["vehicle_goal"], state["pedestrian_goal"] = goals
    tick = Tick(number=frame, state=state, policy_frame=np.ones(1, bool))
    return Step(tick, tick.assessed(np.full(1, np.inf), np.zeros(1), np.zeros(1, bool)), Actions(), NO_EVENTS)


@pytest.mark.parametrize(
    ("credited", "after", "expected"),
    [
        (False, [driven_by_the_autopilot(8, ENDED, GOAL, (1, 1))], (2, 0, 0, 0)),
        (True, [driven_by_the_autopilot(8, ENDED, GOAL, (1, 1))], (8, 1, 1, 1)),
        (True, [driven_by_the_autopilot(6, goals=(0, 1)), driven_by_the_autopilot(8, ENDED, 0, (0, 1))], (8, 0, 1, 0)),
    ],
)
def test_goals_after_the_hand_back_are_those_of_the_last_transition_where_they_are_credited(credited, after, expected):
    """Expected are the frame in which the history is whole, both agents' goals, and whether nothing follows."""
    builder, action = TransitionBuilder(credited), np.ones((1, 2))
    builder.observe(acting(0, 0, 0, Actions(action, action)))
    found = []
    for step in [driven_by_the_autopilot(2), driven_by_the_autopilot(4), *after]:
        found += [(step.tick.number, whole[-1]) for whole in builder.observe(step).histories]
    ((frame, last),) = found
    assert (frame, last["vehicle_goal"], last["pedestrian_goal"], last["terminal"]) == expected
    assert (last["last"], last["next_curvttc"]) == (1, np.inf)


def test_a_history_that_waits_for_its_outcome_ends_where_the_policies_take_over_again():
    builder, action = TransitionBuilder(credit_outcome=True), np.ones((1, 2))
    again, ended = acting(6, 0, 0, Actions(action, action)), driven_by_the_autopilot(8, ENDED, GOAL, (1, 1))
    assert not builder.observe(acting(0, 0, 0, Actions(action, action))).histories
    assert not builder.observe(driven_by_the_autopilot(2)).histories
    (first,) = builder.observe(again).histories
    (second,) = builder.observe(ended).histories
    assert [(h["vehicle_goal"].tolist(), h["terminal"].tolist()) for h in (first, second)] == [([0], [0]), ([1], [1])]
    assert [h["number"].tolist() for h in (first, second)] == [[0], [1]]


def history(episode, steps, first_number=0):
    rows = np.zeros(steps, TRANSITION)
    rows["number"] = first_number + np.arange(steps)
    rows["scenario"], rows["episode"], rows["step"] = 1, episode, np.arange(steps)
    rows["vehicle_observation"][:, 0], rows["next_vehicle_observation"][:, 0] = (
        np.arange(steps),
        np.arange(1, steps + 1),
    )
    rows["last"][-1] = 1
    return rows


def test_interleaved_transitions_become_whole_histories():
    first, second = history(1, 4), history(2, 4)
    mixed = np.concatenate([rows for pair in zip(first, second, strict=True) for rows in ([pair[0]], [pair[1]])])
    mixed["number"] = np.arange(8)
    mixed["collision"][-1] = mixed["terminal"][-1] = 1
    assembler = HistoryAssembler()
    finished = assembler.add(mixed[:5]) + assembler.add(mixed[5:])
    assert [len(h) for h in finished] == [4, 4]
    assert finished[0]["vehicle_observation"][:, 0].tolist() == [0, 1, 2, 3]
    assert finished[1]["collision"].tolist() == [0, 0, 0, 1]
    assert assembler.lost == 0


def test_a_history_of_one_step_is_a_history():
    (finished,) = HistoryAssembler().add(history(1, 1))
    assert len(finished) == 1


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


def test_every_transition_of_the_world_may_be_learned_from(run):
    rows, *_ = run
    assert usable(rows).all()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("vehicle_observation", np.nan),
        ("pedestrian_action", np.inf),
        ("next_vehicle_observation", 1e30),
        ("curvttc", np.nan),
        ("next_curvttc", -1.0),
        ("collision", 2),
    ],
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
