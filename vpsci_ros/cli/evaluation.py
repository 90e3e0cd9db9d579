"""The work of `vpsci evaluate`: errors of policies and naive controls on near misses."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from vpsci_ros.data.corpus import table_hash
from vpsci_ros.data.importers import IMPORTERS, import_trajectories
from vpsci_ros.data.near_misses import clips_of, read_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.error_table import print_errors
from vpsci_ros.evaluation.errors import evaluate
from vpsci_ros.policy.policy_file import SHIPPED, Policy, load_policy, named_policies
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.files import sha256, write_json
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.runs.text_table import table_console


def run_evaluation(data: Path, form: str, models: list[str], json_path: Path | None, *, held_out: bool = False) -> None:
    """Measure policies and naive controls on near misses, print the table, and write the numbers to `json_path`.

    :param models: policies beside the shipped ones, [NAME=]FILE.
    :param data: near-miss table, or a folder of recordings in one of the importers' formats.
    :param held_out: measure only clips that were held out of `models`, or of the shipped people where there are none.
    :raises InvalidInput: unknown format, unreadable data or weights, or no clip of the data was held out.
    """
    table = _near_misses(data, form)
    given = named_policies(models)
    paths = {name: weights_path(name) for name in SHIPPED} | given
    weights = {name: load_policy(path) for name, path in paths.items()}
    chosen = [weights[name] for name in given or SHIPPED[:1]]
    clips = set.intersection(*(_held_out_of(own) for own in chosen))
    kept_out = table.filter(pl.concat_str("source", "clip", separator="/").is_in(sorted(clips)))
    if held_out and kept_out.is_empty():
        raise InvalidInput(
            f"{data}: the weights list none of its clips as held out of training; leave --held-out out, if they have "
            "learned from none of them"
        )
    learned = table["interaction"].n_unique() - kept_out["interaction"].n_unique()
    if held_out:
        table = kept_out
        _warn_of_seen(clips_of(table), {name: own for name, own in weights.items() if name not in given})
    elif kept_out.height and learned:
        print(f"note: {learned} near misses here are of clips that weights have learned from; see --held-out")
    with Bars(f"measuring {table['interaction'].n_unique():,} near misses"):
        result = evaluate(table, weights)
    if json_path is not None:
        made_from = {
            "data": {"path": str(data), "sha256": table_hash(table)},
            "weights_sha256": {name: sha256(path) for name, path in paths.items()},
            "software": software_versions(),
        }
        write_json(json_path, result | made_from)
    print_errors(result, table_console())
    if json_path is not None:
        print(f"written: {json_path}")


def _warn_of_seen(clips: Sequence[str], others: Mapping[str, Policy]) -> None:
    """Print which policies know the source of `clips` and have not held these out, so may have learned from them."""
    for name, own in others.items():
        kept = _held_out_of(own)
        known = {clip.partition("/")[0] for clip in kept}
        if seen := sum(clip.partition("/")[0] in known for clip in clips if clip not in kept):
            print(f"note: {name} may have learned from {seen} of these {len(clips)} clips, so its row is not held out")


def _held_out_of(policy: Policy) -> set[str]:
    """Return the clips, "source/clip", that were held out of a policy, by its metadata."""
    return set(policy.facts.get("data", {}).get("held_out_clips", []))


def _near_misses(data: Path, form: str) -> pl.DataFrame:
    if form == "near-misses" and data.is_dir():
        raise InvalidInput(f"{data}: for a folder of recordings give --format, one of {', '.join(IMPORTERS.names())}")
    if form == "near-misses":
        return read_near_misses(data)
    return import_trajectories(data, form).table
