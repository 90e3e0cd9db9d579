"""What the documentation site (mkdocs.yml) adds to MkDocs: pages generated from the code, and links that leave docs/.

Generated are `commands.md`, from the command line's own declarations, and a page of `api/` for each room of the
library, from its docstrings. The model card lies beside the weights, to be installed with them; here it is a page.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
CARD = "vpsci_ros/models/README.md"
CARD_PAGE = "model_card.md"
_UNIT = re.compile(r"(`[^`]*`)|\[")
_SEVERAL = re.compile(r"^:(param|ivar) (\w+(?:, \w+)+):(.*(?:\n[ \t]+.*)*)", re.MULTILINE)
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:)([^)#\s]+)(#[^)\s]*)?\)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List the pages of the library in the navigation's section of that name."""
    reference = next(part["Reference"] for part in config.nav if "Reference" in part)
    library = next(part for part in reference if "Library" in part)
    library["Library"] = [{f"vpsci_ros.{room}": f"api/{room}.md"} for room in rooms()]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    files.append(File.generated(config, "commands.md", content=commands()))
    files.append(File.generated(config, CARD_PAGE, content=(ROOT / CARD).read_text(encoding="utf-8")))
    for room in rooms():
        files.append(File.generated(config, f"api/{room}.md", content=library_page(room)))
    return files


def rooms() -> list[str]:
    """Return the rooms of the package, in the alphabet's order."""
    return sorted(path.parent.name for path in (ROOT / "vpsci_ros").glob("*/__init__.py"))


def library_page(room: str) -> str:
    """Return the page of a room: its own docstring, then each of its modules."""
    name = f"vpsci_ros.{room}"
    return f"# {name}\n\n::: {name}\n    options:\n      show_submodules: true\n"


def commands() -> str:
    """Return every command with its options, as Typer documents them."""
    import typer
    from typer.cli import get_docs_for_click

    from vpsci_ros.cli.main import app

    command = typer.main.get_command(app)
    return get_docs_for_click(obj=command, ctx=typer.Context(command), name="vpsci", title="Commands")


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links to files outside docs/ into their paths, and those to and from the model card into its page."""
    folder = Path(CARD).parent if page.file.src_uri == CARD_PAGE else Path("docs", page.file.src_uri).parent

    def mend(match: re.Match[str]) -> str:
        image, text, target, anchor = match.groups()
        path = posixpath.normpath(posixpath.join(folder.as_posix(), target))
        if path == CARD:
            page_path = CARD_PAGE
        elif path.startswith("docs/"):
            page_path = path.removeprefix("docs/")
        else:
            return match[0] if target in files.src_uris else f"{text} (`{path}`)"
        here = posixpath.dirname(page.file.src_uri)
        return f"{image}[{text}]({posixpath.relpath(page_path, here or '.')}{anchor or ''})"

    return markdown if page.file.src_uri.startswith(("api/", "commands")) else _LINK.sub(mend, markdown)


class Docstrings(griffe.Extension):  # type: ignore[misc]
    """Has docstrings read as they are meant: "float64[T] [m/s]" is no link, ":param x, y:" describes two parameters."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite one docstring before it is parsed."""
        if obj.docstring:
            text = _UNIT.sub(lambda match: match[1] or r"\[", obj.docstring.value)
            obj.docstring.value = _SEVERAL.sub(_one_each, text)


def _one_each(match: re.Match[str]) -> str:
    kind, names, text = match.groups()
    return "\n".join(f":{kind} {name.strip()}:{text}" for name in names.split(","))
