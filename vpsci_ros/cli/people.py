"""`vpsci people`: a bank of recorded reactions from near misses."""

from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import file_to_write


def people(
    tables: Annotated[
        list[Path],
        typer.Argument(
            metavar="TABLE...", help="Near misses: right_turns, a Parquet file, or a part (right_turns/train)."
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", callback=file_to_write, help="Bank to write, a .safetensors file.")
    ],
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without",
            metavar="SOURCE/CLIP",
            help="Leave out clips whose names begin so, to measure on them; repeatable.",
        ),
    ] = None,
) -> None:
    """Make a bank of recorded reactions, by which agents act: --weights, or the parameter weights of a policy.

    Takes seconds, and needs no torch. The tables must hold whole tracks, as
    `vpsci import` writes them.
    """
    from vpsci_ros.errors import InvalidInput
    from vpsci_ros.policy.bank import save_bank
    from vpsci_ros.policy.make_bank import bank_of_tables

    if output.suffix != ".safetensors":
        raise InvalidInput(f"{output}: expected the name of a .safetensors file")
    bank = bank_of_tables(tables, without or [])
    save_bank(output, bank)
    for name, reactions in bank.reactions.items():
        print(f"{name}: {len(reactions.side)} moments of {len(reactions.steps) * 0.1:.0f} s of reactions")
    data = bank.facts["data"]
    print(f"written: {output}, from {data['interactions']} near misses of {data['clips']} clips")
