#!/usr/bin/env python
"""Campaigns of faults, from a seed: damaged and forged files, disks that refuse, limits, commands and graphs disturbed.

    python test/chaos/campaign.py CAMPAIGN [--cases N] [--seed 0] [--kinds scenario,bag] [-o DIR]

| campaign | of what |
|---|---|
| files | files of every kind, damaged (`chaos.files`) |
| bags | bags in whole files whose messages were forged (`chaos.bags`) |
| disks | every command that writes, on disks that refuse (`chaos.disks`); as root, or after `unshare -rm` |
| folders | commands whose output folder is taken away (`chaos.taken`) |
| limits | every command that writes, with few files, little memory, few processes (`chaos.taken`); as root |
| again | commands that are killed and given once more (`chaos.taken`) |
| processes | graphs whose processes are killed, stopped and delayed (`chaos.processes`) |

Case k of a campaign is the same wherever it runs; `--seed 137 --cases 1` runs one again. Exit status 1 where anything
does not hold. With -o, counts.md is the page of counts, and what was found lies beside it: a damaged file, or a run's
folder. The same command again goes on after the last case that is in cases.jsonl. `make chaos` runs all that take no
root.
"""

import argparse
import collections
import contextlib
import json
import os
import platform
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import track

sys.path.insert(0, str(Path(__file__).parent.parent))

from chaos import bags, commands, disks, files, processes, taken

from vpsci_ros.runs.provenance import software_versions


class Result(NamedTuple):
    """What came of a case: the names that it counts for, a verdict ("defect" for one), and each defect in words."""

    names: list[str]
    verdict: str
    found: tuple[str, ...] = ()


Runner = Callable[[int], Result]
"""Runs the case of a seed."""


def _judged(names: list[str], status: int | None, bad: list[str], about: str) -> Result:
    verdict = "defect" if bad else "complete" if status == 0 else "told"
    return Result(names, verdict, tuple(f"{about}; status {status}): {text}" for text in bad))


@contextlib.contextmanager
def of_files(kind: str, output: Path | None) -> Iterator[Runner]:
    """Count the verdicts on damaged files of a kind."""
    with tempfile.TemporaryDirectory() as folder:
        path = files.KINDS[kind].make(Path(folder))
        whole = path.read_bytes()

        def run(seed: int) -> Result:
            case = files.case(kind, seed, whole, path)
            if case.defect and output is not None:
                (output / f"{kind}_{seed}.bin").write_bytes(case.data)
            text = f"{kind}, case {seed}: {case.verdict}"
            return Result([kind], "defect", (text,)) if case.defect else Result([kind], case.verdict)

        yield run


@contextlib.contextmanager
def of_bags(_: Path | None) -> Iterator[Runner]:
    """Count what came of forged bags by the way in which they were forged."""
    with tempfile.TemporaryDirectory() as folder:
        whole = bags.bag(Path(folder))

        def run(seed: int) -> Result:
            way, verdict = bags.case(seed, whole)
            good = verdict in ("told", "the same")
            return Result([way], verdict) if good else Result([way], "defect", (f"case {seed} ({way}): {verdict}",))

        yield run


@contextlib.contextmanager
def of_disks(_: Path | None) -> Iterator[Runner]:
    """Count how commands ended by the disk that they wrote to."""
    with tempfile.TemporaryDirectory() as folder:
        given = commands.inputs(Path(folder))

        def run(seed: int) -> Result:
            case = disks.case(seed)
            status, bad = disks.run(case, given)
            return _judged([f"{case.place} disk"], status, bad, f"case {seed} ({case}")

        yield run


@contextlib.contextmanager
def of_taken(name: str, _: Path | None) -> Iterator[Runner]:
    """Count how commands ended from which something was taken, by what that was."""
    draw, attempt = taken.CAMPAIGNS[name]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "inputs").mkdir()
        Path(folder).chmod(0o755)
        given = commands.inputs(Path(folder) / "inputs")

        def run(seed: int) -> Result:
            case = draw(seed)
            try:
                status, bad = attempt(case, given, Path(folder) / "case")
            except AssertionError as error:
                status, bad = 1, [str(error)]
            return _judged([case.way], status, bad, f"case {seed} ({case}")

        yield run


@contextlib.contextmanager
def of_processes(output: Path | None) -> Iterator[Runner]:
    """Count how runs ended by signal."""
    whole, lasts = processes.undisturbed()

    def run(seed: int) -> Result:
        disturbed = processes.disturbance(seed, lasts)
        with tempfile.TemporaryDirectory() as folder:
            case = processes.run(Path(folder), disturbed)
            bad = processes.defects(case, disturbed, whole)
            name = f"{disturbed.number.name} to {disturbed.node}"
            return _of_run([name], case, bad, f"case {seed} ({disturbed}", output and output / f"processes_{seed}")

    yield run


@contextlib.contextmanager
def _of_run(names: list[str], case: processes.Run, bad: list[str], about: str, keep: Path | None) -> Result:
    """Return what came of a run of a graph, and keep its folder where something did not hold."""
    if bad and keep is not None and case.folder.is_dir():
        (case.folder / "said.txt").write_text(case.said)
        shutil.copytree(case.folder, keep, dirs_exist_ok=True)
    return _judged(names, case.status, bad, about)


CAMPAIGNS: dict[str, tuple[str, int, Callable[[Path | None], contextlib.AbstractContextManager[Runner]]]] = {
    "bags": ("Forged bags", 1000, of_bags),
    "disks": ("Refused writes", 5 * len(commands.COMMANDS), of_disks),
    "folders": ("Folders taken away", 100, lambda output: of_taken("folders", output)),
    "limits": ("Limits", 100, lambda output: of_taken("limits", output)),
    "again": ("Killed and given again", 40, lambda output: of_taken("again", output)),
    "processes": ("Disturbed graphs", 100, of_processes),
}
"""Name -> title, cases unless said otherwise, and what runs one."""


def page(title: str, results: list[Result], seconds: float) -> str:
    """Return the page of counts as Markdown."""
    counts: dict[str, collections.Counter[str]] = {}
    for result in results:
        for name in result.names:
            counts.setdefault(name, collections.Counter())[result.verdict] += 1
    verdicts = sorted({verdict for counted in counts.values() for verdict in counted} - {"defect"})
    bad = sum(result.verdict == "defect" for result in results)
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    lines = [
        f"# {title}: {len(results):,} cases, {len(results) - bad:,} survived, {bad:,} defects",
        "",
        f"{seconds:,.0f} s on {machine}; {software_versions()['vpsci_ros']} of vpsci_ros.",
        "",
        f"| | cases | {' | '.join(verdicts)} | defects |",
        f"|---|{'---|' * (len(verdicts) + 2)}",
    ]
    for name, counted in sorted(counts.items()):
        cells = " | ".join(f"{counted[verdict]:,}" for verdict in verdicts)
        lines.append(f"| {name} | {sum(counted.values()):,} | {cells} | {counted['defect']:,} |")
    return "\n".join([*lines, "", *(f"- {text}" for result in results for text in result.found), ""])


def run_cases(name: str, seeds: range, runner: Runner, done: dict[str, Result], output: Path | None) -> None:
    """Run the cases that are not among `done`, and add each, also to cases.jsonl."""
    todo = [seed for seed in seeds if f"{name}/{seed}" not in done]
    for seed in track(todo, name.ljust(16), console=Console(stderr=True), transient=True):
        result = done[f"{name}/{seed}"] = runner(seed)
        if output is not None:
            with (output / "cases.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps([f"{name}/{seed}", *result]) + "\n")


def main() -> None:
    """Run a campaign, print its counts, and leave them where asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", choices=("files", *CAMPAIGNS))
    parser.add_argument("--cases", type=int, help="so many (of each kind of file)")
    parser.add_argument("--seed", type=int, default=0, help="number of the first case")
    parser.add_argument("--kinds", default=",".join(files.KINDS), help="of files, with commas; default: all")
    parser.add_argument("-o", "--output", type=Path, help="folder for counts.md and what was found")
    given = parser.parse_args()
    if unknown := set(given.kinds.split(",")) - set(files.KINDS):
        parser.error(f"--kinds: {min(unknown)} is unknown; known: {', '.join(files.KINDS)}")
    title, usual, prepare = CAMPAIGNS.get(given.campaign, ("Damaged files", 1000, None))
    seeds, begun, done = range(given.seed, given.seed + (given.cases or usual)), time.monotonic(), {}
    if given.output is not None:
        given.output.mkdir(parents=True, exist_ok=True)
        for line in _lines(given.output / "cases.jsonl"):
            key, *result = json.loads(line)
            done[key] = Result(*result)
    for number in (signal.SIGINT, signal.SIGTERM):  # also where a shell has it ignored
        signal.signal(number, signal.default_int_handler)
    try:
        for name in given.kinds.split(",") if prepare is None else [given.campaign]:
            with of_files(name, given.output) if prepare is None else prepare(given.output) as runner:
                run_cases(name, seeds, runner, done, given.output)
    except KeyboardInterrupt:
        print("cut off: what is counted is what was done", file=sys.stderr)
    text = page(title, list(done.values()), time.monotonic() - begun)
    print(text)
    if given.output is not None:
        (given.output / "counts.md").write_text(text, encoding="utf-8")
    sys.exit(any(result.found for result in done.values()))


def _lines(path: Path) -> list[str]:
    """Return the whole lines of a file; the last one may be cut off."""
    return path.read_text(encoding="utf-8").split("\n")[:-1] if path.is_file() else []


if __name__ == "__main__":
    main()
