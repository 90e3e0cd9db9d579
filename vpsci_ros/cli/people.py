"""`vpsci people`: a bank of recorded reactions from near misses."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vpsci_ros.cli.options import file_to_write

if TYPE_CHECKING:
    from vpsci_ros.policy.bank import Bank


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

    Takes seconds, and needs no torch. The tables must hold whole tracks, as
    `vpsci import` writes them. Without -o it lists the sources of banks, and
    at which onsets each was recorded: `vpsci people people`.
    """
    from vpsci_ros.documents import counted
    from vpsci_ros.errors import InvalidInput
    from vpsci_ros.policy.bank import Bank, save_bank
    from vpsci_ros.policy.make_bank import bank_of_tables
    from vpsci_ros.policy.policy_file import load_policy

    if output is None:
        if others or without:
            raise InvalidInput("--with and --without make a bank; name its file by -o")
        for name in tables:
            if not isinstance(bank := load_policy(name), Bank):
                raise InvalidInput(f"{name}: expected a bank of recorded people, got weights of networks")
            _print(bank)
        return
    if output.suffix != ".safetensors":
        raise InvalidInput(f"{output}: expected the name of a .safetensors file")
    bank = bank_of_tables(tables, without or [], others or [])
    save_bank(output, bank)
    _print(bank)
    data = bank.facts["data"]
    near_misses, clips = counted(data["interactions"], "near miss", "near misses"), counted(data["clips"], "clip")
    print(f"written: {output}, from {near_misses} of {clips}")


def _print(bank: "Bank") -> None:
    from vpsci_ros.policy.onset_range import LEVELS, QUANTITIES

    levels = ", ".join(f"{100 * level:g}" for level in LEVELS)
    for name, reactions in bank.reactions.items():
        print(f"{name}: {len(reactions.side)} situations of {len(reactions.steps) * 0.1:.0f} s of reactions")
        print(f"  onsets, quantiles of {levels}%")
        for (quantity, unit), values in zip(QUANTITIES.items(), reactions.reach, strict=True):
            print(f"  {quantity + ' [' + unit + ']':<38}{''.join(f'{value:8.1f}' for value in values)}")
