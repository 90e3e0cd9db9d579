"""`vpsci people`: a bank of recorded reactions from near misses."""

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vpsci_ros.cli.options import file_to_write, read_sections, stoppable

if TYPE_CHECKING:
    import polars as pl

    from vpsci_ros.policy.bank import Bank
    from vpsci_ros.policy.forecast import CrossFitted

LEAST_CLIPS = 100  # of a source, to learn a forecast from


def people(
    tables: Annotated[
        list[str],
        typer.Argument(
            metavar="TABLE...",
            help="Near misses: right_turns, a Parquet file, or a part (right_turns/train); without -o banks to list.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", callback=file_to_write, help="Bank to write, a .safetensors file; without it none."
        ),
    ] = None,
    others: Annotated[
        list[Path] | None,
        typer.Option(
            "--with",
            metavar="TABLE",
            help="Near misses of other places, say right_turns: they serve where TABLE has nothing alike; repeatable.",
        ),
    ] = None,
    forecast: Annotated[
        Path | None,
        typer.Option(
            "--forecast",
            metavar="FOLDER",
            help="Learn a forecast, by five trainings in this folder; the same command resumes them.",
        ),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without",
            metavar="SOURCE/CLIP",
            help="Leave out clips whose names begin so, to measure on them; repeatable.",
        ),
    ] = None,
) -> None:
    """Make a bank of recorded reactions, a file for --weights or for a policy's parameter `weights`.

    Takes seconds, and needs no torch; with --forecast some seven minutes of
    one core. The tables must hold whole tracks, as `vpsci import` writes
    them. Without -o it lists the sources of banks, and at which onsets each
    was recorded: `vpsci people people`.
    """
    from vpsci_ros.documents import counted
    from vpsci_ros.errors import InvalidInput
    from vpsci_ros.policy.bank import Bank, save_bank
    from vpsci_ros.policy.make_bank import bank_of_tables
    from vpsci_ros.policy.policy_file import load_policy

    if output is None:
        if others or without or forecast:
            raise InvalidInput("--with, --without and --forecast make a bank; name its file by -o")
        for name in tables:
            if not isinstance(bank := load_policy(name), Bank):
                raise InvalidInput(f"{name}: expected a bank of recorded people, got weights of networks")
            _print(bank)
        return
    if output.suffix != ".safetensors":
        raise InvalidInput(f"{output}: expected the name of a .safetensors file")
    learn = None if forecast is None else _forecasts_in(forecast)
    with nullcontext() if forecast is None else stoppable(forecast):
        bank = bank_of_tables(tables, without or [], others or [], learn)
    save_bank(output, bank)
    _print(bank)
    data = bank.facts["data"]
    near_misses, clips = counted(data["interactions"], "near miss", "near misses"), counted(data["clips"], "clip")
    print(f"written: {output}, from {near_misses} of {clips}")


def _print(bank: "Bank") -> None:
    from vpsci_ros.policy.onset_range import LEVELS, QUANTITIES

    levels = ", ".join(f"{100 * level:g}" for level in LEVELS)
    for name, reactions in bank.reactions.items():
        print(
            f"{name}: {len(reactions.side)} situations of {len(reactions.steps) * 0.1:.0f} s of reactions"
            + (", with a forecast" if reactions.means.shape[1] else "")
        )
        print(f"  onsets, quantiles of {levels}%")
        for (quantity, unit), values in zip(QUANTITIES.items(), reactions.reach, strict=True):
            print(f"  {quantity + ' [' + unit + ']':<38}{''.join(f'{value:8.1f}' for value in values)}")


def _forecasts_in(folder: Path) -> "Callable[[str, pl.DataFrame], CrossFitted | None]":
    """Return what learns a source's forecast by the parameters of stage 1, with a folder for each source."""
    from vpsci_ros.learning.forecast import learn_forecast
    from vpsci_ros.learning.training_config import LearnerConfig, PretrainConfig
    from vpsci_ros.policy.policy_config import NetworkConfig
    from vpsci_ros.runs.progress import StageBar
    from vpsci_ros.runs.stop_request import stop_requested_by_signals

    sections = read_sections(Path("stage1_pretrain"), None)
    config, network = sections.get(PretrainConfig, "learner"), sections.get(NetworkConfig, "learner")
    seed = sections.get(LearnerConfig, "learner").seed

    def learn(source: str, table: "pl.DataFrame") -> "CrossFitted | None":
        clips = table.select("source", "clip").n_unique()
        if clips < LEAST_CLIPS:
            print(f"{source}: no forecast: {clips} clips, expected {LEAST_CLIPS}")
            return None
        with stop_requested_by_signals() as stop, StageBar(f"{source}, all", quiet=False) as bar:

            def report(name: str, values: dict[str, float]) -> None:
                bar.show(values, f"{source}, {name}")
                stop.check()

            return learn_forecast(table, config, network, seed=seed, folder=folder / source, report=report)

    return learn
