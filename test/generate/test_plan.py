"""Units are handed out in order, enough and not many more, and a gap is waited for."""

from vpsci_ros.generate.plan import DatasetPlan


def plan(targets: dict[int, int]) -> DatasetPlan:
    return DatasetPlan(targets, 5, 10)


def test_units_are_consecutive_blocks_from_the_first_episode_on() -> None:
    one = plan({3: 25})
    assert [(u.scenario, list(u.numbers)[:1], len(u.numbers)) for u in (one.next(), one.next())] == [
        (3, [5], 10),
        (3, [15], 10),
    ]


def test_no_more_is_handed_out_than_the_acceptance_so_far_calls_for() -> None:
    one = plan({3: 10})
    first = one.next()
    assert one.next() is None
    one.scenarios[3].take(first, 4)
    units = [one.next(), one.next()]
    assert one.next() is None
    for unit in units:
        one.scenarios[3].take(unit, 2)
    assert not one.complete
    one.scenarios[3].take(one.next(), 3)
    assert one.complete


def test_a_scenario_is_complete_only_without_a_gap() -> None:
    one = plan({3: 20})
    first, second, third = one.scenarios[3].unit(0), one.scenarios[3].unit(1), one.scenarios[3].unit(2)
    one.scenarios[3].take(second, 10)
    one.scenarios[3].take(third, 10)
    assert not one.complete
    one.scenarios[3].take(first, 10)
    assert one.scenarios[3].units_needed() == 2


def test_a_unit_missing_from_an_earlier_run_is_handed_out_first() -> None:
    one = plan({3: 30})
    one.scenarios[3].take(one.scenarios[3].unit(1), 10)
    assert one.next().numbers[0] == 5
    assert one.next().numbers[0] == 25


def test_the_scenario_furthest_behind_comes_next() -> None:
    one = plan({1: 40, 2: 20})
    assert [one.next().scenario for _ in range(5)] == [1, 2, 1, 1, 2]
