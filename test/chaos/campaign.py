#!/usr/bin/env python
"""Campaigns of faults, from a seed: damaged files and disks, graphs whose processes are killed, or among strangers.

    python test/chaos/campaign.py files [--cases 1000] [--seed 0] [--kinds scenario,bag] [-o DIR]
    python test/chaos/campaign.py disks [--cases 64] [--seed 0] [-o DIR]        (as root, or after unshare -rm)
    python test/chaos/campaign.py processes [--cases 100] [--seed 0] [-o DIR]
    python test/chaos/campaign.py strangers [--cases 100] [--seed 0] [-o DIR]

Case k of a campaign is the same wherever it runs; `--seed 137 --cases 1` runs one again. What must hold is said in
`chaos.files`, `chaos.processes` and `chaos.strangers`. Exit status 1 where anything does not. With -o, counts.md is the
page of counts and what was found lies beside it: a damaged file, or the folder of a run. `make chaos` runs all three.
A campaign that is interrupted counts what it has done.
"""

import argparse
import collections
import os
import platform
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console
from rich.progress import track

sys.path.insert(0, str(Path(__file__).parent.parent))

from chaos import disks, files, processes, strangers

from vpsci_ros.runs.provenance import software_versions


class Tally:
    """What a campaign has come to so far: verdicts by name, in how many cases, and the defects."""

    def __init__(self, output: Path | None) -> None:
        self.counts: dict[str, collections.Counter[str]] = {}
        self.cases = self.bad = 0
        self.found: list[str] = []
        self.output = output

    def add(self, names: Iterable[str], verdict: str, found: Iterable[str] = ()) -> None:
        """Take in a case, which counts for each of these names."""
        self.cases, self.bad = self.cases + 1, self.bad + (verdict == "defect")
        self.found += found
        for name in names:
            self.counts.setdefault(name, collections.Counter())[verdict] += 1

    def add_run(self, names: Iterable[str], case: processes.Run, bad: list[str], about: str, folder: str) -> None:
        """Take in a run of a graph, and keep its folder where something did not hold."""
        verdict = "defect" if bad else "complete" if case.status == 0 else "reported"
        self.add(names, verdict, [f"{about}; status {case.status}): {text}" for text in bad])
        if bad and self.output is not None and case.folder.is_dir():
            (case.folder / "said.txt").write_text(case.said)
            shutil.copytree(case.folder, self.output / folder, dirs_exist_ok=True)


def damaged_files(cases: range, kinds: list[str], tally: Tally, console: Console) -> None:
    """Count the verdicts by kind of file."""

    def report(case: files.Found) -> None:
        text = f"{case.kind}, case {case.seed}: {case.verdict}"
        tally.add([case.kind], "defect" if case.defect else case.verdict, [text] if case.defect else [])
        if case.defect and tally.output is not None:
            (tally.output / f"{case.kind}_{case.seed}.bin").write_bytes(case.data)

    for name in kinds:
        files.campaign(name, track(cases, name.ljust(16), console=console, transient=True), report)


def refused_writes(cases: range, tally: Tally, console: Console) -> None:
    """Count how commands ended by the disk that they wrote to."""
    with tempfile.TemporaryDirectory() as folder:
        given = disks.inputs(Path(folder))
        for seed in track(cases, "disks".ljust(16), console=console, transient=True):
            case = disks.case(seed)
            ended = disks.run(case, given)
            verdict = "defect" if ended.defects else "reported" if ended.status else "complete"
            tally.add([f"{case.place} disk"], verdict, [f"case {seed} ({case}): {text}" for text in ended.defects])


def disturbed_processes(cases: range, tally: Tally, console: Console) -> None:
    """Count how runs ended by signal."""
    whole, lasts = processes.undisturbed()
    for seed in track(cases, "processes".ljust(16), console=console, transient=True):
        disturbed = processes.disturbance(seed, lasts)
        with tempfile.TemporaryDirectory() as folder:
            case = processes.run(Path(folder), disturbed)
            bad = processes.defects(case, disturbed, whole)
            name = f"{disturbed.number.name} to {disturbed.node}"
            tally.add_run([name], case, bad, f"case {seed} ({disturbed}", f"processes_{seed}")


def among_strangers(cases: range, tally: Tally, console: Console) -> None:
    """Count how runs ended by what the stranger did; a case counts once for each of its acts."""
    whole, _ = processes.undisturbed()
    for seed in track(cases, "strangers".ljust(16), console=console, transient=True):
        among = strangers.stranger(seed)
        with tempfile.TemporaryDirectory() as folder:
            case = strangers.run(Path(folder), among)
            bad = strangers.defects(case, among, whole)
            names = {f"{act.way} to {act.target}" for act in among.acts}
            tally.add_run(names, case, bad, f"case {seed} ({among}", f"strangers_{seed}")


def page(title: str, tally: Tally, seconds: float) -> str:
    """Return the page of counts as Markdown."""
    verdicts = sorted({verdict for counted in tally.counts.values() for verdict in counted} - {"defect"})
    cases, bad = tally.cases, tally.bad
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    lines = [
        f"# {title}: {cases:,} cases, {cases - bad:,} survived, {bad:,} defects",
        "",
        f"{seconds:,.0f} s on {machine}; {software_versions()['vpsci_ros']} of vpsci_ros.",
        "",
        f"| | cases | {' | '.join(verdicts)} | defects |",
        f"|---|{'---|' * (len(verdicts) + 2)}",
    ]
    for name, counted in sorted(tally.counts.items()):
        cells = " | ".join(f"{counted[verdict]:,}" for verdict in verdicts)
        lines.append(f"| {name} | {sum(counted.values()):,} | {cells} | {counted['defect']:,} |")
    return "\n".join([*lines, "", *(f"- {text}" for text in tally.found), ""])


def main() -> None:
    """Run a campaign, print its counts, and write them to the folder given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", choices=("files", "disks", "processes", "strangers"))
    parser.add_argument("--cases", type=int, help="so many (of each kind of file); default: 1000 files, 100 runs")
    parser.add_argument("--seed", type=int, default=0, help="number of the first case")
    parser.add_argument("--kinds", default=",".join(files.KINDS), help="of files, with commas; default: all")
    parser.add_argument("-o", "--output", type=Path, help="folder for counts.md and what was found")
    given = parser.parse_args()
    if unknown := set(given.kinds.split(",")) - set(files.KINDS):
        parser.error(f"--kinds: {min(unknown)} is unknown; known: {', '.join(files.KINDS)}")
    cases = range(given.seed, given.seed + (given.cases or {"files": 1000}.get(given.campaign, 100)))
    if given.output is not None:
        given.output.mkdir(parents=True, exist_ok=True)
    console, begun, tally = Console(stderr=True), time.monotonic(), Tally(given.output)
    for number in (signal.SIGINT, signal.SIGTERM):  # also where a shell has it ignored
        signal.signal(number, signal.default_int_handler)
    try:
        if given.campaign == "files":
            damaged_files(cases, given.kinds.split(","), tally, console)
        else:
            others = {"disks": refused_writes, "processes": disturbed_processes, "strangers": among_strangers}
            others[given.campaign](cases, tally, console)
    except KeyboardInterrupt:
        console.print("cut off: what is counted is what was done")
    titles = {
        "files": "Damaged files",
        "disks": "Refused writes",
        "processes": "Disturbed graphs",
        "strangers": "Graphs among strangers",
    }
    text = page(titles[given.campaign], tally, time.monotonic() - begun)
    print(text)
    if given.output is not None:
        (given.output / "counts.md").write_text(text, encoding="utf-8")
    sys.exit(bool(tally.found))


if __name__ == "__main__":
    main()
