"""The commands about learning: `vpsci pretrain`, `refine` and `evaluate`."""

from pathlib import Path
from typing import Annotated

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
from vpsci_ros.resources import TO_MEASURE_ON


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
    from vpsci_ros.cli.stages import run_evaluation

    run_evaluation(data, form, weights or [], json_path, held_out=held_out)
