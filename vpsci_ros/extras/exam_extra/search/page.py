"""The result of a search, as one page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vpsci_ros.exam.config import title_of
from vpsci_ros.extras.exam_extra.search.plan import AT_RANDOM
from vpsci_ros.report import html

TITLES = {
    "moving_collision": "the vehicle hits the pedestrian while it moves",
    "collision": "the footprints touch",
    "conflict": "CurvTTC falls below the threshold of a conflict",
    "severe_conflict": "CurvTTC falls below the threshold of a severe conflict",
}
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "search.html"


def write_search_page(path: Path, report: Mapping[str, Any], failures: Sequence[Mapping[str, Any]]) -> None:
    """Write the page.

    :param report: of `run_search`; `failures`: its list, the worst first.
    """
    html.write_page(
        path,
        _TEMPLATE,
        title=f"Search for failures of {report['search']['ads']}",
        report=report,
        count=report["count"],
        failure=TITLES[report["search"]["search"]["failure"]],
        pedestrian=title_of(report["search"]["search"]["pedestrian"]),
        failures=failures,
        at_random=AT_RANDOM,
    )
