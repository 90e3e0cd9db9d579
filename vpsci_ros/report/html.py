"""A self-contained HTML page made from a template: style, text and pictures in one file.

A template lies in `templates/` of the subpackage whose page it is, and extends `base.html` of `report`, which has the
style; `parts.html` has what several pages show alike. Values are escaped unless a template says otherwise.
"""

import base64
import hashlib
import re
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from vpsci_ros.runs.files import write_text

_CHARSET = "<meta charset=utf-8>"
_SHARED = Path(__file__).resolve().parent / "templates"


def write_page(path: Path, template: Path, **values: Any) -> None:
    """Write a page whole or not at all, see `page`."""
    write_text(path, page(template, **values))


def page(template: Path, *, connect: bool = False, **values: Any) -> str:
    """Return the text of a self-contained HTML page.

    :param template: the template's file; a value that it names and that is not given is an error.
    :param connect: whether it may talk to the server that it comes from.
    :param values: what the template names; a `Path` to a PNG becomes a picture by its macro `picture`.
    """
    loader = FileSystemLoader([template.parent, _SHARED])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["base64"] = lambda picture: base64.b64encode(picture.read_bytes()).decode()
    text = environment.get_template(template.name).render(values)
    policy = _policy(text) + ("; connect-src 'self'" if connect else "")
    return text.replace(_CHARSET, f'{_CHARSET}\n<meta http-equiv=Content-Security-Policy content="{policy}">', 1)


def _policy(text: str) -> str:
    """Return what a browser lets a page do: run its own scripts, by their hashes, and show its style and pictures."""
    digests = (hashlib.sha256(text.encode()).digest() for text in re.findall("<script>(.*?)</script>", text, re.DOTALL))
    scripts = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests) or "'none'"
    own = f"script-src {scripts}; style-src 'unsafe-inline'; img-src data:"
    return f"default-src 'none'; {own}; base-uri 'none'; form-action 'none'"
