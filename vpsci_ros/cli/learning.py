"""The commands that learn from recordings: `vpsci import`, `pretrain`, `refine` and `evaluate`."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from vpsci_ros.cli.options import (
    NearMisses,
    Params,
    Quiet,
    Resumable,
    Settings,
    file_to_write,
    read_sections,
    stoppable,
    writes_folder,
)
from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import TO_MEASURE_ON


def import_command(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Folders of recordings as published.")],
    formats: Annotated[
        list[str],
        typer.Option(
            "--format", help="Format of all folders, or one for each: vci-dut, levelx, ... (docs/formats.md)."
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", callback=file_to_write, help="Parquet file to write.")],
    name: Annotated[
        str | None,
        typer.Option("--name", metavar="SOURCE", help="Name of the source, by which --people chooses its reactions."),
    ] = None,
    fastest: Annotated[
        float | None,
        typer.Option("--fastest", min=0.0, metavar="M/S", help="Leave out pedestrians with a higher median speed."),
    ] = None,
    kinds: Annotated[
        str,
        typer.Option("--kinds", metavar="KIND,...", help="Whom to import, of walker, cyclist and scooter."),
    ] = "walker",
    frame_rate: Annotated[
        float,
        typer.Option("--frame-rate", min=0.0, metavar="1/S", help="Of files that count frames; 0: the format's."),
    ] = 0.0,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse the first clip or road user with a fault.")] = False,
    compact: Annotated[bool, typer.Option("--compact", help="Write single precision: a third as large.")] = False,
    check: Annotated[
        bool,
        typer.Option("--check", help="Draw near misses to OUTPUT.png, print extent and speeds; import nothing."),
    ] = False,
) -> None:
    """Write a table of near misses: recorded pairs whose CurvTTC falls below 5 s, in steps of 0.1 s."""
    from vpsci_ros.data import importers
    from vpsci_ros.data.importers.tracks import require_source
    from vpsci_ros.data.near_misses import write_near_misses
    from vpsci_ros.runs.progress import Bars

    given: dict[str, Any] = {"frame_rate": frame_rate, "kinds": [kind.strip() for kind in kinds.split(",")]}
    options = {"fastest": math.inf if fastest is None else fastest, "strict": strict} | given
    if check:
        from vpsci_ros.report.recordings import check_recordings

        picture = output.with_suffix(".png")
        print("\n".join(check_recordings(folders, formats, picture, **options)))
        print(f"written: {picture}")
        return
    if output.suffix != ".parquet":
        raise InvalidInput(f"-o {output}: a table of near misses is Parquet; expected the name of a .parquet file")
    importers.importers_of(folders, formats, **given)  # refuses options before the work begins
    if name is not None:
        require_source(name, "--name")
    with Bars(f"importing {', '.join(map(str, folders))}"):
        result = importers.import_folders(folders, formats, **options)
    importers.require_near_misses(result)
    result = result if name is None else importers.named(result, name)
    write_near_misses(result.table, output, result.metadata, compact=compact)
    importers.print_import_summary(result)
    print(f"written: {output}")


@writes_folder
def pretrain(
    output: Resumable,
    params: Params = Path("stage1_pretrain"),
    near_misses: NearMisses = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Train on recorded near misses (stage 1).

    Writes pretrained.safetensors, log.csv, learning.png, params.yaml and
    run.json. The same command resumes a stopped run, to the same result.
    `vpsci graph` runs the same stage through a node.
    """
    from vpsci_ros.cli.stages import run_pretraining

    with stoppable(output):
        run_pretraining(read_sections(params, settings, near_misses), output, quiet=quiet)


@writes_folder
def refine(
    output: Resumable,
    params: Params = Path("stage2_online"),
    near_misses: NearMisses = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Train in simulation (stage 2), starting from the weights of the parameter learner.weights.

    Writes refined.safetensors, refine_log.csv, learning.png (Figure 6),
    params.yaml and run.json. The same command resumes a stopped run, to the
    same result. `vpsci graph` runs the same stage through the nodes.
    """
    from vpsci_ros.cli.stages import run_refinement

    with stoppable(output):
        run_refinement(read_sections(params, settings, near_misses), output, quiet=quiet)


def evaluate(
    data: Annotated[
        Path,
        typer.Option(
            "--data",
            metavar="TABLE",
            help="Near misses: right_turns, a Parquet file, a part; or a folder of recordings.",
        ),
    ] = Path(TO_MEASURE_ON),
    form: Annotated[
        str, typer.Option("--format", help="near-misses, or a format of vpsci import (docs/formats.md).")
    ] = "near-misses",
    json_path: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", callback=file_to_write, help="Write all numbers to this file."),
    ] = None,
    weights: Annotated[
        list[str] | None,
        typer.Option("--weights", metavar="[NAME=]FILE", help="Further policies: files or shipped names; repeatable."),
    ] = None,
    held_out: Annotated[
        bool, typer.Option("--held-out", help="Measure only clips held out of all --weights (without: of people).")
    ] = False,
) -> None:
    """Print errors of the shipped and given policies on near misses, beside naive controls, in Table 9's columns.

    All near misses of the data count; give --held-out, or recordings that
    the weights have not seen.
    """
    from vpsci_ros.cli.evaluation import run_evaluation

    run_evaluation(data, form, weights or [], json_path, held_out=held_out)
