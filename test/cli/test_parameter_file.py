"""Parameter files: whatever nothing reads is refused by name, with what reads it."""

from pathlib import Path

import pytest
import yaml

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.training_config import RefineConfig


def written(folder: Path, **sections: dict) -> Path:
    path = folder / "params.yaml"
    path.write_text(yaml.safe_dump({name: {"ros__parameters": values} for name, values in sections.items()}))
    return path


def refused(path: Path, settings: tuple[str, ...] = ()) -> str:
    with pytest.raises(InvalidInput) as caught:
        load(path, settings)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_parameter_of_the_other_stage_is_refused_and_the_stage_that_reads_it_named(tmp_path: Path) -> None:
    text = refused(written(tmp_path, learner={"stage": "refine", "episodes": 3000, "held_out_clips": ["a/b"]}))
    for name in ("episodes", "held_out_clips"):
        expected = f"learner.{name}: nothing reads it in stage 2 (learner.stage: refine), but in stage 1"
        assert expected in text
    text = refused(written(tmp_path, learner={"episodes": 3}, world_simulator={"batch": 8}))
    assert "world_simulator.batch: nothing reads it in stage 1 (learner.stage: pretrain), but in stage 2" in text
    text = refused(written(tmp_path, world_simulator={"batch": 8}, replayer={"rate": 2.0}))
    assert "replayer.rate: nothing reads it in stage 3, but in the node replayer by itself" in text


def test_a_shared_parameter_that_no_node_of_the_stage_has_is_refused(tmp_path: Path) -> None:
    assert load(written(tmp_path, learner={"stage": "pretrain"}, **{"/**": {"seed": 7}})).values["learner"]["seed"] == 7
    text = refused(written(tmp_path, learner={"stage": "pretrain"}, **{"/**": {"batch": 8}}))
    assert "/**.batch: nothing reads it in stage 1" in text


def test_what_the_exam_sets_itself_is_refused_in_its_file(tmp_path: Path) -> None:
    text = refused(written(tmp_path, ads_test={"ads": "example_ads"}, world_simulator={"batch": 8, "seed": 3}))
    assert text.endswith("world_simulator.batch: the exam sets it itself")


def test_groups_may_be_written_as_mappings_or_with_dots(tmp_path: Path) -> None:
    first = load(written(tmp_path, learner={"stage": "refine", "replay": {"batch_size": 64}}))
    second = load(written(tmp_path, learner={"stage": "refine", "replay.batch_size": 64}))
    assert first == second
    assert first.get(RefineConfig, "learner").replay.batch_size == 64


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected sections 'node: ros__parameters: ...', got an empty file"),
        (
            "learner: {ros__parameters: {stage: refien}}",
            "stage = 'refien' is unknown; expected one of pretrain, refine",
        ),
        (
            "learner: {ros__parameters: {updates: {actor_learning_rat: 0.9}}}",
            "did you mean updates.actor_learning_rate?",
        ),
        ("learner: {ros__parameters: {episodes: }}", "episodes must be a whole number, got None"),
        (
            "learner: {ros__parameters: {updates: {actor_learning_rate: .nan}}}",
            "updates.actor_learning_rate is not a number; expected",
        ),
        ("learner: {ros__parameters: &a {updates: *a}}", "an alias (*a)"),
        ("a: &a [1]\nb: &b [*a, *a]\nc: [*b, *b]", "an alias (*a)"),
        ("learner: {ros__parameters: {seed: 1}}\nlearner: {ros__parameters: {seed: 2}}", "'learner' is there twice"),
        ("[" * 100_000, "nested deeper than"),
        ("learner: {ros__parameters: {seed: " + "9" * 400 + "}}", "64 bits"),
        ("learner: {ros__parameters: {? [1, 2] : 3}}", "not readable as YAML"),
        ("\0", "not readable as YAML"),
    ],
)
def test_a_hostile_file_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(text)
    said = refused(path)
    assert message in said
