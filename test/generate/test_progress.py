"""What a run shows where there is no terminal."""

from vpsci_ros.generate.plan import DatasetPlan
from vpsci_ros.generate.run import ProgressOfRun


def shown(capsys, quiet: bool) -> str:
    plan = DatasetPlan({1: 20, 2: 20}, 0, 10, 100.0)
    with ProgressOfRun({1: "LocationA_PedCross_S-N", 2: "LocationA_PedCross_N-S"}, quiet=quiet, interval=0.0) as bar:
        plan.scenarios[1].take(plan.scenarios[1].unit(0), 10)
        bar.show(plan)
        plan.scenarios[2].take(plan.scenarios[2].unit(0), 4)
        bar.show(plan)
    return capsys.readouterr().err


def test_a_line_tells_kept_simulated_rate_and_time_left(capsys) -> None:
    begun, first, last = shown(capsys, quiet=False).splitlines()
    assert begun.strip().startswith("begun; a line every ")
    assert first.strip().startswith("10 of 40 kept, 10 simulated, 0 kept/h")  # that was there before
    assert last.strip().startswith("14 of 40 kept, 20 simulated, ")
    assert last.endswith(" left")


def test_a_unit_that_keeps_more_than_was_wanted_makes_no_rate_negative(capsys) -> None:
    plan = DatasetPlan({1: 20}, 0, 30, 100.0)
    with ProgressOfRun({1: "LocationA_PedCross_S-N"}, interval=0.0) as bar:
        plan.scenarios[1].take(plan.scenarios[1].unit(0), 27)
        bar.show(plan)
        bar.show(plan)
    assert all("20 of 20 kept, 30 simulated, 0 kept/h" in line for line in capsys.readouterr().err.splitlines()[1:])


def test_a_run_that_is_over_before_a_line_is_due_says_how_it_ended(capsys) -> None:
    plan = DatasetPlan({1: 20}, 0, 30, 100.0)
    with ProgressOfRun({1: "LocationA_PedCross_S-N"}) as bar:
        bar.show(plan)
        plan.scenarios[1].take(plan.scenarios[1].unit(0), 20)
        bar.show(plan)
    _, line = capsys.readouterr().err.splitlines()
    assert line.strip().startswith("20 of 20 kept, 30 simulated, ")


def test_quiet_is_quiet(capsys) -> None:
    assert shown(capsys, quiet=True) == ""
