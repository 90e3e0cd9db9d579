#!/usr/bin/env python
"""Campaigns of faults, from a seed: damaged files, and graphs whose processes are killed, stopped and delayed.

    python test/chaos/campaign.py files [--cases 1000] [--seed 0] [--kinds scenario,bag] [-o DIR]
    python test/chaos/campaign.py processes [--cases 100] [--seed 0] [-o DIR]

Case k of a campaign is the same wherever it runs; `--seed 137 --cases 1` runs one again. What must hold is said in
`chaos.files` and `chaos.processes`. Exit status 1 where anything does not. With -o, counts.md is the page of counts and
what was found lies beside it: a damaged file, or the folder of a run. `make chaos` runs both.
"""

import argparse
import collections
import os
import platform
import shutil
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.progress import track

sys.path.insert(0, str(Path(__file__).parent.parent))

from chaos import files, processes

from vpsci_ros.runs.provenance import software_versions

Counts = dict[str, collections.Counter[str]]


def damaged_files(cases: range, kinds: list[str], output: Path | None, console: Console) -> tuple[Counts, list[str]]:
    """Return the verdicts by kind of file, and the defects."""
    counts: Counts = {}
    found: list[str] = []
    for name in kinds:
        counts[name] = collections.Counter()

        def report(case: files.Found, counted: collections.Counter[str] = counts[name]) -> None:
            counted["defect" if case.defect else case.verdict] += 1
            if case.defect:
                found.append(f"{case.kind}, case {case.seed}: {case.verdict}")
                if output is not None:
                    (output / f"{case.kind}_{case.seed}.bin").write_bytes(case.data)

        files.campaign(name, track(cases, name.ljust(16), console=console, transient=True), report)
    return counts, found


def disturbed_processes(cases: range, output: Path | None, console: Console) -> tuple[Counts, list[str]]:
    """Return how runs ended by signal, and the defects."""
    counts: Counts = collections.defaultdict(collections.Counter)
    found: list[str] = []
    whole, lasts = processes.undisturbed()
    for seed in track(cases, "processes".ljust(16), console=console, transient=True):
        disturbed = processes.disturbance(seed, lasts)
        with tempfile.TemporaryDirectory() as folder:
            case = processes.run(Path(folder), disturbed)
            bad = processes.defects(case, disturbed, whole)
            counted = counts[f"{disturbed.number.name} to {disturbed.node}"]
            counted["defect" if bad else "complete" if case.status == 0 else "told"] += 1
            found += [f"case {seed} ({disturbed}; status {case.status}): {text}" for text in bad]
            if bad and output is not None:
                shutil.copytree(case.folder, output / f"processes_{seed}", dirs_exist_ok=True)
    return dict(sorted(counts.items())), found


def page(title: str, counts: Counts, found: list[str], seconds: float) -> str:
    """Return the page of counts as Markdown."""
    verdicts = sorted({verdict for counted in counts.values() for verdict in counted} - {"defect"})
    total = sum(sum(counted.values()) for counted in counts.values())
    bad = sum(counted["defect"] for counted in counts.values())
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    lines = [
        f"# {title}: {total:,} cases, {total - bad:,} survived, {bad:,} defects",
        "",
        f"{seconds:,.0f} s on {machine}; {software_versions()['vpsci_ros']} of vpsci_ros.",
        "",
        f"| | cases | {' | '.join(verdicts)} | defects |",
        f"|---|{'---|' * (len(verdicts) + 2)}",
    ]
    for name, counted in counts.items():
        cells = " | ".join(f"{counted[verdict]:,}" for verdict in verdicts)
        lines.append(f"| {name} | {sum(counted.values()):,} | {cells} | {counted['defect']:,} |")
    return "\n".join([*lines, "", *(f"- {text}" for text in found), ""])


def main() -> None:
    """Run a campaign, print its counts, and leave them where asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", choices=("files", "processes"))
    parser.add_argument("--cases", type=int, help="so many (of each kind of file); default: 1000 files, 100 runs")
    parser.add_argument("--seed", type=int, default=0, help="number of the first case")
    parser.add_argument("--kinds", default=",".join(files.KINDS), help="of files, with commas; default: all")
    parser.add_argument("-o", "--output", type=Path, help="folder for counts.md and what was found")
    given = parser.parse_args()
    if unknown := set(given.kinds.split(",")) - set(files.KINDS):
        parser.error(f"--kinds: {min(unknown)} is unknown; known: {', '.join(files.KINDS)}")
    cases = range(given.seed, given.seed + (given.cases or {"files": 1000, "processes": 100}[given.campaign]))
    if given.output is not None:
        given.output.mkdir(parents=True, exist_ok=True)
    console, begun = Console(stderr=True), time.monotonic()
    if given.campaign == "files":
        counts, found = damaged_files(cases, given.kinds.split(","), given.output, console)
    else:
        counts, found = disturbed_processes(cases, given.output, console)
    text = page({"files": "Damaged files", "processes": "Disturbed graphs"}[given.campaign], counts, found,
                time.monotonic() - begun)  # fmt: skip
    print(text)
    if given.output is not None:
        (given.output / "counts.md").write_text(text, encoding="utf-8")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
