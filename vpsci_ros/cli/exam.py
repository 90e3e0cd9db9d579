"""The command that puts a driving system to the exam: `vpsci ads-test`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from vpsci_ros.cli.options import Params, Quiet, Settings, read_sections, stoppable, writes_folder
from vpsci_ros.errors import InvalidInput


@writes_folder
def ads_test(
    output: Annotated[Path, typer.Option("--output", "-o", help="Output folder: new, empty, or of the same exam.")],
    params: Params = Path("ads_test"),
    ads: Annotated[
        str | None,
        typer.Option(
            "--ads",
            metavar="COMMAND",
            help="Command that starts the driving system, such as 'python my_ads.py'; 'external' if you start it "
            "yourself in this ROS_DOMAIN_ID. Default: the parameter file's, example_ads.",
        ),
    ] = None,
    ads_class: Annotated[
        str | None,
        typer.Option(
            "--ads-class",
            metavar="MODULE:CLASS",
            help="Python class with reset(begin) and act(observation) that is the driving system instead: many "
            "episodes side by side in this process, without ROS (docs/ads.md).",
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(
            "--socket",
            min=0,
            metavar="PORT",
            help="With --ads: it connects to this TCP port of the loopback instead of ROS (docs/ads.md); 0: a free "
            "one, which it finds in VPSCI_ADS_PORT.",
        ),
    ] = None,
    episodes: Annotated[
        str | None,
        typer.Option(
            metavar="N|FILE",
            help="Episodes in each scenario, with each pedestrian; or a list of episodes, as --search leaves it.",
        ),
    ] = None,
    search: Annotated[
        bool,
        typer.Option(
            "--search",
            help="Find the episodes in which it fails, and how often it does (ads_test.search, docs/search.md).",
        ),
    ] = False,
    budget: Annotated[
        int | None, typer.Option(min=40, metavar="N", help="With --search: episodes that it may drive.")
    ] = None,
    recorded: Annotated[
        Path | None,
        typer.Option(metavar="TABLE", help="Meet recorded people as well: right_turns, a Parquet file, a part of one."),
    ] = None,
    baseline: Annotated[
        Path | None,
        typer.Option(
            "--baseline",
            metavar="RUN",
            help="Folder of an earlier exam: say which of its episodes are fixed, newly broken, unchanged.",
        ),
    ] = None,
    guard: Annotated[
        int | None,
        typer.Option(
            min=0, metavar="N", help="With --baseline: drive its failures and N of its episodes again, not all."
        ),
    ] = None,
    protocol: Annotated[
        str | None,
        typer.Option(
            "--protocol",
            metavar="NAME",
            help="Drive a standard protocol's tests as well, with its points: euro-ncap (docs/ads.md).",
        ),
    ] = None,
    why: Annotated[
        int,
        typer.Option(
            "--why",
            min=0,
            metavar="N",
            help="Drive the N worst failures with each pedestrian again, one thing changed at a time, and say what "
            "would have avoided them (docs/ads.md).",
        ),
    ] = 0,
    fail_if: Annotated[
        list[str] | None,
        typer.Option(
            "--fail-if",
            metavar="'MEASURE > NUMBER [@PEDESTRIAN]'",
            help="Exit with status 1 where this holds, with the pedestrian named or with any; repeatable.",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Graphs (or processes of a class) side by side; all else is equal."),
    ] = None,
    ray: Annotated[
        str | None,
        typer.Option("--ray", metavar="ADDRESS", help="On the hosts of a Ray cluster: its address, auto or local."),
    ] = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Put a driving system to the exam: the same episodes with the learned and with reference pedestrians.

    Exit status: 0 passed; 1 a --fail-if holds, or the driving system did not drive all episodes; 2 bad input.
    """
    from vpsci_ros.exam.episode_list import with_episode_list
    from vpsci_ros.exam.protocol import PROTOCOLS
    from vpsci_ros.exam.run import prepare, run_exam
    from vpsci_ros.exam.search.run import run_search

    sections = read_sections(params, settings)
    if episodes is not None and episodes.isdecimal():
        sections = sections.changed("world_simulator", {"episodes": int(episodes)})
    elif episodes is not None:
        sections = with_episode_list(sections, Path(episodes))
    if budget is not None:
        sections = sections.changed("ads_test", {"search.budget": budget})
    if recorded is not None:
        sections = sections.changed("ads_test", {"recorded": str(recorded)})
    if protocol is not None and protocol not in PROTOCOLS:
        raise InvalidInput(f"--protocol {protocol}: unknown; expected {', '.join(PROTOCOLS)}")
    if search:
        if fail_if or recorded or episodes or baseline or protocol or why or ray:
            raise InvalidInput(
                "--search goes without --fail-if, --recorded, --episodes, --baseline, --protocol, --why and --ray; put "
                "what it finds to an exam with these: --episodes failures.json"
            )
        exam = prepare(sections, ads, ads_class, workers or 1, port)
        with stoppable(output):
            failures = run_search(exam, output, workers=workers or 1, quiet=quiet)
        for reason in failures:
            print(f"failed: {reason}", file=sys.stderr)
    elif guard is not None and baseline is None:
        raise InvalidInput("--guard is of --baseline; --episodes N says how many episodes an exam has")
    elif budget is not None:
        raise InvalidInput("--budget is of --search; --episodes N says how many episodes an exam has")
    else:
        exam = prepare(sections, ads, ads_class, workers or 1, port)
        with stoppable(output):
            failures = run_exam(
                exam,
                output,
                fail_if or [],
                workers=workers,
                ray=ray,
                against=baseline,
                guard=guard,
                protocol=protocol or "",
                why=why,
                quiet=quiet,
            )
    if failures:
        raise typer.Exit(1)
