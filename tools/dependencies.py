#!/usr/bin/env python
r"""Write what is installed for what, its licences and its hashes, from a report of pip.

    pip install --dry-run --ignore-installed --report report.json -c constraints.txt \
        '.[learn,ros,messages,rl,exam_extra,paper,formats,carla,drive,cluster,planner,sumo,highway,baselines,test,docs]'
    .venv/bin/python tools/dependencies.py report.json

Writes docs/dependencies.md (what this package itself requires), docs/dependencies.csv (every package) and
constraints-hashes.txt: the files that pip chose on this platform, each with its SHA-256. Builds whose version names one
(torch's "+cpu") are left out of the latter: PyPI does not serve them.
"""

import argparse
import csv
import importlib.metadata
import json
import platform
import re
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
HEAD = """# Dependencies

For those who check licences or pin versions. `tools/dependencies.py` writes this page: the packages that this package
itself requires, by the licence in their metadata. [dependencies.csv](dependencies.csv) has version, licence and purpose
of all {count} packages of `make setup` on {platform}. The package.xml of ROS 2's wheels states
Apache-2.0, BSD-3-Clause or MIT.

`constraints.txt` has the tested versions, `constraints-hashes.txt` the SHA-256 of their files on that platform:

    pip install --require-hashes --no-deps -r constraints-hashes.txt

| licence | packages |
|---|---|
"""


def licence(metadata: dict[str, Any]) -> str:
    """Return the licence in a package's metadata: its SPDX expression, its classifiers, or its first line."""
    if expression := metadata.get("license_expression") or installed(metadata["name"], "License-Expression"):
        return str(expression)
    named = [text.split(" :: ")[-1] for text in metadata.get("classifier", []) if text.startswith("License ::")]
    named = [name for name in named if name != "OSI Approved"]
    text = (metadata.get("license") or "").strip().splitlines()
    return ", ".join(named) or (text[0][:60] if text else "not stated")


def installed(name: str, field: str) -> str:
    """Return a field of the installed package's metadata, which older releases of pip leave out of their report."""
    try:
        found = importlib.metadata.metadata(name)
    except importlib.metadata.PackageNotFoundError:
        return ""
    return str(found[field]) if field in found else ""


def reasons(items: list[dict[str, Any]], root: str) -> dict[str, list[str]]:
    """Return by package whose direct requirement it is: this package's extras first, else other packages."""
    found: dict[str, list[str]] = {}
    for item in sorted(items, key=lambda item: canonical(item["metadata"]["name"]) != root):
        name = canonical(item["metadata"]["name"])
        for text in item["metadata"].get("requires_dist", []):
            requirement = Requirement(text)
            extra = re.search(r'extra == "([\w-]+)"', str(requirement.marker or ""))
            who = (f"extra {extra[1]}" if extra else "the package itself") if name == root else name
            if name == root or not extra:
                found.setdefault(canonical(requirement.name), []).append(who)
    return found


def canonical(name: str) -> str:
    """Return a name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def write_pages(rows: list[tuple[str, str, str, str]], system: str) -> None:
    """Write docs/dependencies.csv from (package, version, licence, for), and docs/dependencies.md."""
    with (ROOT / "docs" / "dependencies.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([("package", "version", "licence", "for"), *rows])
    own = [row for row in rows if row[3].startswith(("extra ", "the package")) and not row[0].startswith("ros-")]
    head = HEAD.format(count=len(rows), platform=system)
    named: dict[str, list[str]] = {}
    for package, _, terms, _ in own:
        named.setdefault("not stated" if terms.startswith("%") else terms, []).append(package)  # a field not filled in
    lines = [f"| {terms} | {', '.join(packages)} |\n" for terms, packages in sorted(named.items())]
    (ROOT / "docs" / "dependencies.md").write_text(head + "".join(lines), encoding="utf-8")


def main() -> None:
    """Write the three files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=Path, help="what `pip install --report` wrote")
    items = json.loads(parser.parse_args().report.read_text(encoding="utf-8"))["install"]
    root = canonical("vpsci_ros")
    why = reasons(items, root)
    rows, hashes = [], []
    for item in sorted(items, key=lambda item: canonical(item["metadata"]["name"])):
        name, version = canonical(item["metadata"]["name"]), item["metadata"]["version"]
        if name == root:
            continue
        rows.append((name, version, licence(item["metadata"]), ", ".join(why.get(name, [])[:3])))
        digest = item["download_info"].get("archive_info", {}).get("hashes", {}).get("sha256")
        if digest and "+" not in version:
            hashes.append(f"{name}=={version} --hash=sha256:{digest}")
    system = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    write_pages(rows, system)
    about = f"# Files of the tested packages for {system}, by tools/dependencies.py; see docs/dependencies.md.\n"
    (ROOT / "constraints-hashes.txt").write_text(about + "\n".join(hashes) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
