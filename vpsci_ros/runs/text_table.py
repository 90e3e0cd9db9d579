"""Tables of numbers as text for a terminal."""

from collections.abc import Iterable, Sequence

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

_WIDEST = 130  # characters of the widest table


def table_console() -> Console:
    """Return a console in which no table loses the ends of its cells; a narrow terminal breaks the lines itself."""
    return Console(width=max(Console().width, _WIDEST))


def text_table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str] | None]) -> Padding:
    """Return a table with an empty line below; the first column is left-aligned, the others right-aligned.

    :param rows: their cells; None begins another section of the table.
    """
    view = Table(box=box.SIMPLE_HEAD, title=escape(title) or None, title_justify="left", padding=(0, 1, 0, 0))
    view.show_edge = view.pad_edge = False
    for place, head in enumerate(heads):
        view.add_column(escape(head), justify="right" if place else "left", no_wrap=True)
    for cells in rows:
        if cells is None:
            view.add_section()
        else:
            view.add_row(*map(escape, cells))
    return Padding(view, (0, 0, 1, 0), expand=False)


def quartiles_text(quartiles: Iterable[float]) -> str:
    """Return quartiles as the text of one table cell; "-" for no values."""
    return "  ".join(f"{value:.2f}" for value in quartiles) or "-"


def short_name(scenario: str) -> str:
    """Return a scenario's short name, such as "A S-N"."""
    return scenario.removeprefix("Location").replace("_PedCross_", " ")
