"""Each value that docs/parameters.md names in words is accepted, and does what the page says."""

import re
from pathlib import Path

import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.cli.stages import stage_1_inputs
from vpsci_ros.data.corpus import held_out_by
from vpsci_ros.data.near_misses import clips_of

ROOT = Path(__file__).resolve().parents[2]
NAMED = {  # stage file -> settings with a value that the description of the parameter names
    "stage1_pretrain": [
        ("learner", "held_out_clips", "[none]", "[none] holds out no clip"),
        ("learner", "held_out_clips", "[cqut-pvi/train/corner1/g1]", "SOURCE/CLIP"),
        ("learner", "near_misses", "[]", "empty: right_turns/train"),
        ("learner", "near_misses", "[right_turns]", "right_turns, Parquet files"),
        ("learner", "near_misses", "[right_turns/dev]", "right_turns/dev"),
        ("learner", "objective", "closed_loop", "closed_loop, imitation"),
        ("learner", "objective", "ddpg", "ddpg, Algorithm 1's"),
        ("learner", "encoder", "sst", "sst, the paper's"),
        ("learner", "stage", "pretrain", "pretrain: stage 1"),
    ],
    "stage2_online": [("learner", "stage", "refine", "refine: stage 2")],
    "stage3_generate": [
        ("world_simulator", "crowd.sizes", "[]", "empty: always"),
        ("world_simulator", "lane_following", "true", "true: lane keeping"),
        ("pedestrian_policy", "people", "cqut-pvi", "such as cqut"),
        ("pedestrian_policy", "agent", "learned", "learned: acts by"),
    ],
    "ads_test": [
        ("ads_test", "timing", "own", "own: pedestrians"),
        ("ads_test", "timing", "autopilot", "autopilot: as drawn"),
        ("ads_test", "ads", "external", "external: you start it"),
        ("ads_test", "recorded", "right_turns/dev", "right_turns/dev"),
    ],
}


@pytest.mark.parametrize(("stage", "named"), [(stage, each) for stage, own in NAMED.items() for each in own])
def test_a_value_that_the_page_names_is_accepted(stage: str, named: tuple[str, str, str, str]) -> None:
    section, name, value, words = named
    page = (ROOT / "docs/parameters.md").read_text()
    assert re.search(rf"^\| `{re.escape(name)}` \|.*{re.escape(words)}", page, re.MULTILINE)
    sections = load(ROOT / f"params/{stage}.yaml", [f"{section}.{name}={value}"])
    if stage == "stage1_pretrain" and "g1" not in value:
        assert stage_1_inputs(sections)[3].height


@pytest.mark.parametrize(("value", "share"), [("[none]", 0.0), ("[]", 0.2)])
def test_none_holds_out_no_clip_and_no_name_a_fifth(value: str, share: float) -> None:
    sections = load(ROOT / "params/stage1_pretrain.yaml", [f"learner.held_out_clips={value}"])
    _, config, _, corpus, _ = stage_1_inputs(sections)
    training, held_out = held_out_by(corpus, config.held_out_clips)
    several = [table["interaction"].n_unique() for table in (training, held_out)]
    assert several[1] / sum(several) == pytest.approx(share, abs=0.01)
    assert not set(clips_of(training)) & set(clips_of(held_out))
