"""The commands `vpsci study`, `vpsci turing` and `vpsci published`."""

from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import (
    Cluster,
    MixedCpus,
    NearMisses,
    Params,
    Quiet,
    Resumable,
    Settings,
    read_sections,
    site_of,
    stoppable,
    writes_folder,
)
from vpsci_ros.documents import given_names
from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import RIGHT_TURNS, TO_MEASURE_ON

Workers = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Trainings side by side, instead of one; all else is equal.")
]
study_app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="The paper's Tables 3 and 9, and all its figures and tables.",
    short_help="Repeat the paper's studies, tables and figures.",
    rich_help_panel="Measure",
)
turing_app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="The Turing test of section 4.4: recorded or generated?",
    short_help="Ask people: recorded or generated?",
    rich_help_panel="Measure",
)
published_app = typer.Typer(add_completion=False)


@published_app.command(
    rich_help_panel="Generate and look", short_help="Write the authors' published files as a dataset."
)
@writes_folder
def published(
    source: Annotated[Path, typer.Argument(metavar="DIR", help="The authors' CSV files: a folder, or one file.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write the dataset into; new or empty.")],
) -> None:
    """Write the authors' published files as a dataset, for report, view, dataset info and study paper."""
    from vpsci_ros.extras.paper.published_tables import convert

    convert(source, output)
    print(f"written: {output}")


@study_app.command()
@writes_folder
def samples(
    params: Params,
    output: Resumable,
    near_misses: NearMisses = None,
    sizes: Annotated[
        str | None,
        typer.Option(metavar="N,N,...", help="Numbers of training interactions, one run each; default: Table 3's."),
    ] = None,
    settings: Settings = None,
    workers: Workers = None,
    cluster: Cluster = None,
    mixed_cpus: MixedCpus = False,
    quiet: Quiet = False,
) -> None:
    """Repeat Table 3: stage 1 on 50 to 336 interactions, beside the paper's values.

    Prints rewards and critic losses of the training, and rewards and errors on
    held-out clips, which are the same for all sizes, beside two controls.
    Writes table_3.csv, run.json and a folder for each size. The same command
    resumes a stopped study (Ctrl-C); finished sizes are not trained again.

    In full, with params/stage1_pretrain.yaml: six minutes on one core.
    For a test of a minute: --sizes 50,100 --set learner.episodes=20
    """
    from vpsci_ros.extras.paper.studies.run_studies import run_sample_study

    chosen = given_names(sizes or "", "--sizes")
    if not all(part.isdigit() for part in chosen):
        raise InvalidInput(f"--sizes {sizes}: expected whole numbers with commas, say 50,100")
    site = site_of(workers, cluster, mixed_cpus)
    with stoppable(output):
        sections = read_sections(params, settings, near_misses)
        run_sample_study(sections, output, [*map(int, chosen)], site=site, quiet=quiet)


@study_app.command()
@writes_folder
def models(
    params: Params,
    output: Resumable,
    near_misses: NearMisses = None,
    chosen: Annotated[
        str | None,
        typer.Option("--models", metavar="NAME,...", help="Networks to compare; default: all."),
    ] = None,
    count: Annotated[
        int, typer.Option("--folds", min=2, metavar="N", help="Number of folds of the clips, each held out once.")
    ] = 5,
    refine: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Hybrid learning: stage 2 of the models by reinforcement.")
    ] = None,
    simulated: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Hybrid learning: simulated near misses for the other models.")
    ] = None,
    fresh_episodes: Annotated[
        int, typer.Option(min=1, metavar="N", help="Episodes in each scenario for measuring outcomes.")
    ] = 40,
    settings: Settings = None,
    workers: Workers = None,
    cluster: Cluster = None,
    mixed_cpus: MixedCpus = False,
    quiet: Quiet = False,
) -> None:
    """Repeat Table 9: its models, by supervision and by reinforcement, with and without hybrid learning.

    All models have the same inputs, near misses and number of updates. sst,
    transformer, lstm and feedforward predict the next velocity; ..._ddpg and
    ddpg are trained by reinforcement. With --refine params/stage2_online.yaml
    and --simulated TABLE each is also trained in simulation and measured there
    (..._refined). Writes models.json, models.md, run.json and a
    folder for each fold, with weights for --weights. The same command resumes
    a stopped study (Ctrl-C); finished trainings are not repeated.

    The paper's numbers: paper_stage1, --refine paper_stage2. A test of a minute:
    --models sst,lstm --folds 2 --set learner.episodes=20
    """
    from vpsci_ros.extras.paper.studies.run_studies import run_model_study

    site = site_of(workers, cluster, mixed_cpus)
    with stoppable(output):
        run_model_study(
            read_sections(params, settings, near_misses),
            output,
            given_names(chosen or "", "--models"),
            folds=count,
            refine=None if refine is None else read_sections(refine, None, near_misses),
            simulated=simulated,
            fresh_episodes=fresh_episodes,
            site=site,
            quiet=quiet,
        )


@study_app.command()
@writes_folder
def paper(
    dataset: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a dataset.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same command.")],
    near_misses: Annotated[
        Path, typer.Option(metavar="TABLE", help="Recorded near misses: right_turns, a Parquet file, a part of one.")
    ] = Path(RIGHT_TURNS),
    rules: Annotated[Path | None, typer.Option(metavar="DIR", help="Dataset of the rule-based pair.")] = None,
    runs: Annotated[
        list[Path] | None,
        typer.Option("--run", metavar="DIR", help="Folder of refine, study or turing score; repeatable."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Write the paper's figures and tables of results, from a dataset and from finished runs, as one page.

    Figures 4, 5, 7 to 9, 11 to 13 and Tables 6, 7, 10 come from the dataset,
    recorded near misses and a dataset of the rule-based pair (`vpsci report
    --help` has its command). Figures 6, 10 and Tables 3, 9, 11 come from
    the runs of --run. The page lists missing parts with their commands.
    Writes paper.html, paper.json and figure_N.png.
    """
    from vpsci_ros.extras.paper.studies.paper import PAGE, write_paper
    from vpsci_ros.runs.output_folder import output_folder
    from vpsci_ros.runs.progress import Bars

    with output_folder(output), Bars("reading", quiet=quiet) as bars:
        missing = write_paper(dataset, output, near_misses=near_misses, rules=rules, runs=runs or (), notify=bars.line)
    for name, command in missing.items():
        print(f"not given: {name.replace('_', ' ')} ({command})")
    print(f"written: {output / PAGE}; paper.json and figure_N.png beside it")


@turing_app.command()
@writes_folder
def make(
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same command.")],
    near_misses: Annotated[
        Path, typer.Argument(metavar="TABLE", help="Near misses: right_turns, a Parquet file, or a part of one.")
    ] = Path(TO_MEASURE_ON),
    weights: Annotated[
        str, typer.Option(metavar="FILE", help="Policies to be rated: a file, or the name of shipped ones.")
    ] = "people",
    scenes: Annotated[int, typer.Option(min=2, max=200, metavar="N", help="Scenes, of three clips of 4 s each.")] = 8,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the drawn scenes.")] = 1,
) -> None:
    """Write questionnaire.html for the raters, and key.json, which they must not see.

    Each scene has three clips from the same start: the recording, the policies,
    and the rule-based pair, which replaces CARLA's default controller. The page
    does not name the sources. The paper has --scenes 4.
    """
    from vpsci_ros.extras.paper.turing.kit import make_kit

    key = make_kit(near_misses, weights, output, scenes=scenes, seed=seed)
    known = sum(not scene["held_out"] for scene in key["scenes"])
    if known:
        print(f"note: {known} of the {scenes} scenes are of clips that the weights do not list as held out of training")
    print(f"written: {output / 'questionnaire.html'} with {3 * scenes} clips, for the raters,")
    print(f"and {output / 'key.json'}, which they must not see")


@turing_app.command()
@writes_folder
def score(
    key: Annotated[Path, typer.Argument(metavar="KEY", help="key.json of `vpsci turing make`.")],
    answers: Annotated[list[Path], typer.Argument(metavar="ANSWERS...", help="The raters' files.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same command.")],
) -> None:
    """Write Table 11 and Figure 10 beside the paper's values."""
    from vpsci_ros.extras.paper.turing.answers import read_answers
    from vpsci_ros.extras.paper.turing.result_page import PAGE, write_result

    result = write_result(read_answers(key, answers), output)
    rated = ", ".join(f"{source} {share:.0%}" for source, share in result["rated_real"].items())
    print(f"{result['raters']} raters, {result['clips']} clips; rated as real: {rated}")
    for name, why in result["excluded"].items():
        print(f"excluded from Table 11: {name}, {why}")
    print(f"written: {output / PAGE}; turing.json and figure_10.png beside it")
