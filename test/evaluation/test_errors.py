import io
import json

import numpy as np
import polars as pl
import pytest
from rich.console import Console
from synthetic import synthetic_near_misses

from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.error_table import print_errors
from vpsci_ros.evaluation.errors import CONTROLS, SAMPLER, evaluate
from vpsci_ros.evaluation.predictors import RepeatVelocity


class Jerky(RepeatVelocity):
    """Brakes the vehicle whatever happens."""

    def act(self, vehicle, pedestrian, curvttc, active):
        none, _ = super().act(vehicle, pedestrian, curvttc, active)
        return none + np.array([-2.0, 0.0], np.float32), none


@pytest.fixture(scope="module")
def result():
    return evaluate(synthetic_near_misses(interactions=16, seed=3).table, {"same": RepeatVelocity(), "jerky": Jerky()})


def test_the_controls_are_always_among_the_models_and_json_takes_it_all(result):
    assert set(result["models"]) == {"same", "jerky", *CONTROLS, SAMPLER}
    assert json.loads(json.dumps(result)) == result
    assert set(result["models"][SAMPLER]) == {"fixed_3s"}, "the sampler has one length"
    for model in (own for name, own in result["models"].items() if name != SAMPLER):
        for protocol in ("reconstruction", "closed_loop"):
            assert {"ade", "fde", "rmse"} <= set(model[protocol])


def test_in_closed_loop_the_first_two_controls_are_the_same_and_in_reconstruction_looking_again_helps(result):
    repeat, constant = (result["models"][name] for name in ("repeat_velocity", "constant_velocity"))
    assert repeat["closed_loop"] == constant["closed_loop"]
    assert repeat["reconstruction"]["ade"] < constant["reconstruction"]["ade"]


def test_a_car_whose_published_speed_lags_is_followed_better_from_its_positions():
    table = synthetic_near_misses(interactions=16, seed=3).table
    lagging = table.with_columns(pl.col("veh_vx", "veh_vy", "veh_speed") * 1.2)
    models = evaluate(lagging, {})["models"]
    tracked, recorded = (models[f"constant_velocity{name}"]["closed_loop"] for name in ("_tracked", ""))
    assert tracked["ade_vehicle"] < 0.8 * recorded["ade_vehicle"]
    assert tracked["ade_pedestrian"] == recorded["ade_pedestrian"]


def test_a_model_must_not_take_the_name_of_a_control():
    with pytest.raises(InvalidInput, match="repeat_velocity"):
        evaluate(synthetic_near_misses(interactions=4, seed=3).table, {"repeat_velocity": RepeatVelocity()})


def test_the_fixed_3_s_of_one_roll_out_have_the_ade_as_energy_score(result) -> None:
    assert result["fixed_3s"]["interactions"] > 10
    for name, of in result["models"].items():
        if name != SAMPLER:
            assert of["fixed_3s"]["energy_score"] == pytest.approx(of["fixed_3s"]["ade"])
    assert result["models"]["fading_acceleration"]["fixed_3s"]["ade_of_fading_acceleration"] == pytest.approx(1.0)
    assert result["models"]["constant_velocity_tracked"]["fixed_3s"]["of_constant_velocity"] == pytest.approx(1.0)
    jerky, control = (result["models"][name]["fixed_3s"]["ade"] for name in ("jerky", "repeat_velocity"))
    assert jerky > control


def test_the_intervals_of_one_long_recording_resample_its_groups_and_say_so(result) -> None:
    table = synthetic_near_misses(interactions=16, seed=3).table
    one = evaluate(table.with_columns(clip=pl.lit("long")), {"same": RepeatVelocity(), "jerky": Jerky()})
    assert one["clips"] == one["fixed_3s"]["clips"] == 1
    for of, units in ((one, "groups"), (result, "clips")):  # each made-up near miss has a vehicle and a clip of its own
        assert of["units"] == f"{of['interactions']} {units}"
        assert of["fixed_3s"]["units"] == f"{of['fixed_3s']['interactions']} {units}"
    of, theirs = (each["models"]["jerky"] for each in (one, result))
    for protocol in ("reconstruction", "closed_loop"):
        low, high = of[protocol]["ade_interval"]
        assert low < of[protocol]["ade"] == theirs[protocol]["ade"] < high
    console = Console(record=True, width=100, file=io.StringIO())
    print_errors(one, console)
    assert f"Intervals: 95%, {one['units']} resampled." in " ".join(console.export_text().split())
