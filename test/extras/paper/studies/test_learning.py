import polars as pl
import pytest

from vpsci_ros.errors import InvalidInput, Stopped
from vpsci_ros.extras.paper.studies.learning import sample_size_study
from vpsci_ros.learning.training_config import PretrainConfig, ReplayConfig
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import load_weights

SMALL = NetworkConfig(hidden=16, heads=2)
STAGE_1 = PretrainConfig(
    episodes=3,
    replay=ReplayConfig(batch_size=10),
)


def test_sizes_are_measured_on_the_same_clips_none_of_which_they_learn_from(tmp_path, near_misses):
    table = sample_size_study(near_misses, STAGE_1, SMALL, sizes=(4, 8, 16), seed=1, out_dir=tmp_path)
    assert table["interactions"].to_list() == ["4", "8", "16", "repeat_velocity", "fading_acceleration"]
    assert (table["vehicle_reward"].drop_nulls() < 0.0).all()
    measured = table["closed_loop_ade"].is_not_null().to_list()
    assert measured == [True, True, False, True, True], "16 are all that there are, so none is left to measure on"
    assert table["vehicle_held_out_reward"].is_not_null().to_list() == [*measured[:4], False]
    learned_from = [load_weights(tmp_path / n / "pretrained.safetensors").facts["data"] for n in ("4", "8", "16")]
    assert [data["interactions"] for data in learned_from] == [4, 8, 16]
    assert pl.read_csv(tmp_path / "table_3.csv").height == 5


def test_a_stopped_study_goes_on_with_the_size_that_is_missing(tmp_path, near_misses):
    def study(folder, report, seed=1):
        options = {"sizes": (4, 8), "seed": seed, "out_dir": tmp_path / folder, "report": report}
        return sample_size_study(near_misses, STAGE_1, SMALL, **options)

    def stop(size, values):
        if (size, values["episode"]) == ("8", 2):
            raise Stopped

    seen = []
    with pytest.raises(Stopped):
        study("parts", stop)
    resumed = study("parts", lambda size, values: seen.append((size, values["episode"])))
    assert seen == [("8", 3)]
    assert resumed.equals(study("whole", lambda *_: None))
    with pytest.raises(InvalidInput, match="a run with seed = 1, and this one has 2"):
        study("parts", stop, seed=2)
