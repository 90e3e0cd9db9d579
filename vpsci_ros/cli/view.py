"""The commands that show episodes to people: `vpsci view`, and `vpsci turing` make, score."""

from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import writes_folder
from vpsci_ros.resources import TO_MEASURE_ON

turing_app = typer.Typer(no_args_is_help=True, help="The Turing test of section 4.4: recorded or generated?")


def view(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="SOURCE...", help="Near-miss tables, folders of datasets, bags, folders of exams."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="HTML file to write.")] = Path("view.html"),
    limit: Annotated[
        int, typer.Option(min=1, max=20_000, metavar="N", help="Most episodes of each source, evenly spread.")
    ] = 1000,
    episodes: Annotated[
        list[str] | None,
        typer.Option(
            "--episode", metavar="NAME", help="Show this episode only, say 6:12 or 17; repeatable; for one source."
        ),
    ] = None,
    title: Annotated[str, typer.Option(help="Title of the page; default: the sources' names.")] = "",
) -> None:
    """Write one HTML page that plays episodes from above; it opens from disk without a network.

    Two sources play side by side: recorded beside generated episodes, or the
    driving system of an exam beside the autopilot.
    """
    from vpsci_ros.errors import InvalidInput
    from vpsci_ros.exam.run import is_exam, read_exam
    from vpsci_ros.view.page import write_view
    from vpsci_ros.view.sources import read_source

    if episodes and (len(sources) > 1 or is_exam(sources[0])):
        raise InvalidInput("--episode goes with one table, dataset or bag; give one, or leave --episode out")
    found = []
    for path in sources:
        found += read_exam(path, limit) if is_exam(path) else [read_source(path, limit, episodes or ())]
    size = write_view(output, found, title or ", ".join(path.resolve().name for path in sources))
    for source in found:
        part = f" of {source.total:,}, evenly spread" if len(source.episodes) < source.total and not episodes else ""
        print(f"  {source.title}: {len(source.episodes):,} episodes{part}")
    print(f"written: {output} ({size / 1e6:.1f} MB); open it in a browser")


@turing_app.command()
@writes_folder
def make(
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same command.")],
    near_misses: Annotated[
        Path, typer.Argument(metavar="TABLE", help="Near misses: right_turns, a Parquet file, or a part of one.")
    ] = Path(TO_MEASURE_ON),
    weights: Annotated[
        str, typer.Option(metavar="FILE", help="Policies to be rated; or shipped ones' name.")
    ] = "refined",
    scenes: Annotated[int, typer.Option(min=2, max=200, metavar="N", help="Each makes three clips of 4 s.")] = 8,
    seed: Annotated[int, typer.Option(min=0, help="Of the draw.")] = 1,
    temperature: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="Of stochastic policies; 0: their deterministic middle.")
    ] = 1.0,
) -> None:
    """Write questionnaire.html for the raters, and key.json, which they must not see.

    A scene is shown as recorded, as the policies go on from the same start,
    and as the rule-based pair does, in the place of CARLA's default controller;
    the page says nothing of which is which. The paper has --scenes 4.
    """
    from vpsci_ros.turing.kit import make_kit

    key = make_kit(near_misses, weights, output, scenes=scenes, seed=seed, temperature=temperature)
    known = sum(not scene["held_out"] for scene in key["scenes"])
    if known:
        print(f"note: {known} of the {scenes} scenes are of recordings that the weights have learned from")
    print(f"written: {output / 'questionnaire.html'} with {3 * scenes} clips, for the raters,")
    print(f"and {output / 'key.json'}, which they must not see")


@turing_app.command()
@writes_folder
def score(
    key: Annotated[Path, typer.Argument(metavar="KEY", help="key.json of `vpsci turing make`.")],
    answers: Annotated[list[Path], typer.Argument(metavar="ANSWERS...", help="The raters' files.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for turing.html, turing.json and Figure 10.")],
) -> None:
    """Say who was recognised, Table 11 and Figure 10 beside the paper's values, and what stays open."""
    from vpsci_ros.turing.answers import read_answers
    from vpsci_ros.turing.page import PAGE, write_result

    result = write_result(read_answers(key, answers), output)
    accuracy = result["recognised"]["generated"]["accuracy"]
    bounds = "" if accuracy["low"] is None else f" [{accuracy['low']:.1%}, {accuracy['high']:.1%}]"
    excluded = result["as_the_paper"]["excluded"]
    print(f"{result['raters']} raters, {result['clips']} clips; recorded and generated ones distinguished in "
          f"{accuracy['value']:.1%}{bounds}")  # fmt: skip
    for name, why in excluded.items():
        print(f"excluded from the paper's own analysis: {name}, {why}")
    for text in result["not_concluded"]:
        print(f"open: {text}")
    print(f"written: {output / PAGE}; turing.json and figure_10.png beside it")
