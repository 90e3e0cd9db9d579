import pytest
from rich.console import Console
from synthetic import synthetic_near_misses

from vpsci_ros.errors import InvalidInput, Stopped
from vpsci_ros.evaluation.errors import CONTROLS, evaluate
from vpsci_ros.learning.config import ImitationConfig, PretrainConfig
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.studies.model_comparison import compare_models
from vpsci_ros.studies.networks import MODELS
from vpsci_ros.studies.tables import print_table_9, save_table_9

pytestmark = pytest.mark.usefixtures("one_thread")

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, actor_hidden=[8, 8], critic_hidden=[8, 8])
CONFIG = PretrainConfig(episodes=2, imitation=ImitationConfig(rollouts=2, rollout_steps=2))


@pytest.fixture(scope="module")
def table():
    return synthetic_near_misses(interactions=16, seed=3).table


@pytest.fixture(scope="module")
def whole(table, tmp_path_factory):
    options = {"models": list(MODELS.built_in), "folds": 2, "seed": 1, "out_dir": tmp_path_factory.mktemp("whole")}
    return compare_models(table, CONFIG, SMALL, **options)


def test_every_model_is_measured_beside_the_controls_on_all_interactions(whole, table):
    assert list(whole["models"]) == [*MODELS.built_in, *CONTROLS]
    alone = evaluate(table, {}, seed=1)
    assert whole["interactions"] == alone["interactions"]
    for name in CONTROLS:
        theirs, mine = (of["models"][name]["closed_loop"]["ade"] for of in (alone, whole))
        assert mine == pytest.approx(theirs)
    for protocol in ("reconstruction", "closed_loop"):
        rows = {name: whole["models"][name][protocol] for name in MODELS.built_in}
        assert rows["ma_sst"]["share_of_ma_sst"] == (1.0, [1.0, 1.0])
        value, (low, high) = rows["lstm"]["share_of_ma_sst"]
        assert value == pytest.approx(rows["lstm"]["ade"] / rows["ma_sst"]["ade"])
        assert low <= value <= high
    assert whole["models"]["lstm"]["parameters"] != whole["models"]["sst"]["parameters"]


def test_a_stopped_comparison_goes_on_and_keeps_what_was_trained(tmp_path, table, whole):
    def stop(fold, values):
        if (fold, values["episode"]) == ("2", CONFIG.episodes + 1):  # in the second model of the second fold
            raise Stopped

    options = {"models": ["ma_sst", "lstm"], "folds": 2, "seed": 1, "out_dir": tmp_path}
    with pytest.raises(Stopped):
        compare_models(table, CONFIG, SMALL, **options, report=stop)
    seen = []
    result = compare_models(table, CONFIG, SMALL, **options, report=lambda fold, v: seen.append((fold, v["episode"])))
    assert seen == [("2", 3), ("2", 4)]
    for name in ("ma_sst", "lstm"):
        for protocol in ("reconstruction", "closed_loop"):
            assert result["models"][name][protocol] == whole["models"][name][protocol]
    with pytest.raises(InvalidInput, match="a run with seed = 1, and this one has 2"):
        compare_models(table, CONFIG, SMALL, **options | {"seed": 2})


def test_the_table_fits_eighty_columns_and_the_picture_is_one(tmp_path, whole):
    console = Console(width=80, record=True)
    print_table_9(whole, console)
    text = console.export_text()
    assert "…" not in text
    assert all(name in text for name in MODELS.built_in)
    assert "[1.783]" in text
    save_table_9(whole, tmp_path / "models.png")
    assert (tmp_path / "models.png").read_bytes().startswith(b"\x89PNG")
