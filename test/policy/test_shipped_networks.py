"""The shipped networks have learned by the recipes of the parameter files, and do what the model card says."""

from dataclasses import replace

import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.corpus import load_corpus
from vpsci_ros.evaluation.onsets import find_onsets
from vpsci_ros.evaluation.outcomes import measure_outcomes
from vpsci_ros.evaluation.roll_out_scores import energy_score
from vpsci_ros.evaluation.simulators import policy, tracked
from vpsci_ros.extras.paper.rates import rates_with_intervals
from vpsci_ros.learning.training_config import PretrainConfig, RefineConfig
from vpsci_ros.parameters import values_of
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.resources import params_dir, weights_path
from vpsci_ros.world import WorldConfig, load_scenarios
from vpsci_ros.world.observation import AGENTS

# section 3.2: control ends half a second after the danger, and nothing but (18) steers
PAPER = WorldConfig(spawn="paper", episode_time=10.0, pedestrian_gain=0.5, release_time=0.5, lane_following=False)
EPISODES = [(scenario, number) for number in range(25) for scenario in range(1, 9)]


@pytest.fixture(scope="module")
def weights():
    return load_weights(weights_path("closed_loop"))


@pytest.mark.parametrize(
    ("name", "files", "shape"),
    [
        ("closed_loop", ("stage1_pretrain", "stage2_online"), NetworkConfig()),
        ("ma_sst_ddpg", ("paper_stage1", "paper_stage2"), NetworkConfig(hidden=256, layers=2)),
    ],
)
def test_each_was_learned_by_its_parameter_files_and_the_papers_at_the_papers_size(name, files, shape):
    own = load_weights(weights_path(name))
    network, first, second = (own.configuration[name] for name in ("NetworkConfig", "PretrainConfig", "RefineConfig"))
    assert NetworkConfig(**network) == own.network == shape
    for stage in (first, second):  # a constant that ma_sst_ddpg has recorded, and closed_loop alone read, when it was 0
        assert stage.pop("closed_loop.policy_gradient", 0.0) == 0.0
    assert first == values_of(load(params_dir() / f"{files[0]}.yaml").get(PretrainConfig, "learner"))
    assert second == values_of(load(params_dir() / f"{files[1]}.yaml").get(RefineConfig, "learner"))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--paper"], "ma_sst_ddpg has --hidden 256 --layers 2; got 64 and 1"),
        (["--hidden", "256", "--layers", "2"], "closed_loop has --hidden 64 --layers 1; got 256 and 2"),
        (["--seed", "4", "5"], "expected one seed"),
    ],
)
def test_networks_of_another_size_or_of_several_seeds_are_not_installed(tool, monkeypatch, capsys, given, said):
    module = tool("make_weights")
    monkeypatch.setattr(module, "learn", lambda *_: pytest.fail("it began to learn"))
    monkeypatch.setattr("sys.argv", ["make_weights.py", "--install", *given])
    with pytest.raises(SystemExit, match="2"):
        module.main()
    assert said in capsys.readouterr().err


def test_people_are_predicted_at_most_a_twentieth_worse_than_by_an_acceleration_that_fades(weights):
    """Over the 3 s after the onsets of right turns that nothing was learned from."""
    onsets = find_onsets(load_corpus(["right_turns/dev"]))
    own, none = (policy(each, 0)(onsets) for each in (weights, without_network(weights)))
    score, control = (energy_score(positions, onsets.recorded).mean() for positions in (own, none))
    assert score < 1.05 * control < 0.75 * energy_score(tracked(onsets), onsets.recorded).mean()


def without_network(weights):
    """The weights with actors whose networks add nothing: the acceleration at the onset goes on and fades."""
    names = [f"{agent}_actor.head.4.{part}" for agent in AGENTS for part in ("weight", "bias")]
    return replace(weights, tensors=weights.tensors | {name: 0.0 * weights.tensors[name] for name in names})


def outcomes(weights, world):
    """Rates of 200 episodes with the weights and, as the control, without any acceleration."""
    simulation = SimulationConfig(load_scenarios(range(1, 9)), EPISODES, batch=256, seed=20261121, world=world)
    return (rates_with_intervals(measure_outcomes(of, simulation)) for of in (weights, None))


@pytest.mark.parametrize("name", ["closed_loop", "ma_sst_ddpg"])
def test_in_the_papers_scenes_each_collides_less_than_the_papers_and_reaches_more_goals_on_the_road(name):
    learned, control = outcomes(load_weights(weights_path(name)), PAPER)
    assert learned["critical_episodes"] == control["critical_episodes"] > 100
    assert learned["collision_rate"] < 0.04 < 0.6 < control["collision_low"]
    assert learned["goal_low"] > 0.812 > control["goal_high"]


def test_in_default_scenes_few_collide_where_half_would_without_a_reaction(weights):
    learned, control = outcomes(weights, WorldConfig())
    assert learned["collision_high"] < 0.05 < 0.35 < control["collision_low"]
