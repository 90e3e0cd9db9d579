"""README and docs: every link leads somewhere, every command that they show is one, every file in docs is read."""

import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer

from vpsci_ros.cli.main import app

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "vpsci_ros/models/README.md",
    *sorted((ROOT / "vpsci_ros/extras").glob("*/README.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
VPSCI = typer.main.get_command(app)
_LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)")
_BLOCK = re.compile(r"^```(?:bash|sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@cache
def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    titles = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title).lower().replace(" ", "-") for title in titles}


def commands(page: Path) -> Iterator[list[str]]:
    """Yield the words of every `vpsci ...` line in a page's shell blocks and in its tables."""
    text = page.read_text("utf-8")
    lines = [line for block in _BLOCK.findall(text) for line in block.replace("\\\n", " ").splitlines()]
    lines += re.findall(r"^\| `(vpsci [^`]*)`", text, re.MULTILINE)
    for line in lines:
        words = shlex.split(line, comments=True)
        if words[:1] == ["vpsci"]:
            yield words[1:]


def options(words: list[str]) -> tuple[Any, list[str]]:
    """Follow words down to the command that they name; return it and the options given to it."""
    command, rest = VPSCI, list(words)
    while hasattr(command, "commands") and rest:
        name = rest.pop(0)
        found = command.get_command(typer.Context(command), name)
        assert found is not None, f"vpsci {' '.join(words)}: no command {name!r}"
        command = found
    if "--ros-args" in rest:
        rest = rest[: rest.index("--ros-args")]
    return command, [word.partition("=")[0] for word in rest if re.match(r"--?[a-z]", word)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    for target, anchor in _LINK.findall(page.read_text("utf-8")):
        path = (page.parent / target).resolve() if target else page
        assert path.exists(), f"{page.name}: {target}"
        assert not anchor or anchor in anchors(path), f"{page.name}: {target}#{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_shown_exists_with_the_options_shown(page: Path) -> None:
    for words in commands(page):
        command, given = options(words)
        known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
        assert set(given) <= known | {"--help"}, f"{page.name}: vpsci {' '.join(words)}"


def test_every_page_and_picture_of_docs_is_linked_from_somewhere() -> None:
    linked = set()
    for page in PAGES:
        text = page.read_text("utf-8")
        linked |= {(page.parent / target).resolve() for target, _ in _LINK.findall(text) if target}
        linked |= {(ROOT / name).resolve() for name in re.findall(r"docs/[\w./-]+\.\w+", text)}
    left = [path.name for path in (ROOT / "docs").rglob("*") if path.is_file() and path.resolve() not in linked]
    assert not left


def test_each_promise_names_a_test_that_there_is() -> None:
    page = (ROOT / "docs" / "promises.md").read_text("utf-8")
    known: dict[str, set[str]] = {}  # file name -> tests in files of this name, and "" for the file itself
    for path in (ROOT / "test").rglob("test_*.py"):
        tests = re.findall(r"^def (test_\w+)\(", path.read_text("utf-8"), re.MULTILINE)
        known.setdefault(path.name, {""}).update(tests)
    named = re.findall(r"`(test_\w+\.py)(?:::(test_\w+))?`", page)
    assert sum(1 + bool(name) for _, name in named) == page.count("test_") > 30
    assert [f"{file}::{name}" for file, name in named if name not in known.get(file, ())] == []
