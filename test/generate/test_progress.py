"""What a run shows where there is no terminal."""

from vpsci_ros.generate.plan import DatasetPlan
from vpsci_ros.generate.progress import ProgressOfRun


def shown(capsys, quiet: bool) -> str:
    plan = DatasetPlan({1: 20, 2: 20}, 0, 10, 100.0)
    with ProgressOfRun({1: "LocationA_PedCross_S-N", 2: "LocationA_PedCross_N-S"}, quiet=quiet, interval=0.0) as bar:
        plan.scenarios[1].take(plan.scenarios[1].unit(0), 10)
        bar.show(plan)
        plan.scenarios[2].take(plan.scenarios[2].unit(0), 4)
        bar.show(plan)
    return capsys.readouterr().err


def test_a_line_tells_kept_simulated_rate_and_time_left(capsys, monkeypatch) -> None:
    monkeypatch.setattr("vpsci_ros.runs.progress.LATER", 0.0)  # every line is said
    begun, first, last = shown(capsys, quiet=False).splitlines()
    assert begun.strip().startswith("begun; a line follows every ")
    assert first.strip().startswith("10 of 40 kept, 10 simulated, 0 kept/h")  # that was there before
    assert last.strip().startswith("14 of 40 kept, 20 simulated, ")
    assert last.endswith(" left")


def test_quiet_is_quiet(capsys) -> None:
    assert shown(capsys, quiet=True) == ""
