"""The result of a search, as one page with a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vpsci_ros.exam.config import title_of
from vpsci_ros.exam.search.margin import STANDING
from vpsci_ros.exam.search.plan import AT_RANDOM, Plan
from vpsci_ros.report import html
from vpsci_ros.report.canvas import new_figure, save_png

TITLES = {
    "moving_collision": "the vehicle hits the pedestrian while it moves",
    "collision": "the footprints touch",
    "conflict": "CurvTTC falls below the threshold of a conflict",
    "severe_conflict": "CurvTTC falls below the threshold of a severe conflict",
}
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "search.html"
_SHOWN = (-0.5, 3.0)  # [m] or [s] of margin
_BLUE, _RED, _GREY = "#0072b2", "#d55e00", "#9a9a9a"


def write_search_page(path: Path, report: Mapping[str, Any], plan: Plan, failures: Sequence[Mapping[str, Any]]) -> None:
    """Write the page, and search.png beside it.

    :param report: of `run_search`; `failures`: its list, the worst first.
    """
    picture = path.parent / "search.png"
    failure = report["search"]["search"]["failure"]
    save_search(plan, failure, picture)
    html.write_page(
        path,
        _TEMPLATE,
        title=f"Search for failures of {report['search']['ads']}",
        report=report,
        count=report["count"],
        failure=TITLES[failure],
        pedestrian=title_of(report["search"]["search"]["pedestrian"]),
        failures=failures,
        at_random=AT_RANDOM,
        picture_of_search=picture,
    )


def save_search(plan: Plan, failure: str, path: Path) -> None:
    """Draw as a PNG what was rehearsed and driven by margin, and the chance of a failure that was learned from it."""
    unit = "s" if failure.endswith("conflict") else "m"
    figure, axes = new_figure(9.0, 4.6, rows=2, sharex=True)
    above, below = axes.flat
    edges = np.linspace(*_SHOWN, 71)
    rehearsed = np.where(plan.driven, plan.margin_before, plan.margin)
    above.hist(np.clip(rehearsed, *_SHOWN), edges, color=_GREY, label="in the pool")
    above.hist(np.clip(plan.margin_before[plan.driven], *_SHOWN), edges, color=_BLUE, label="driven")
    above.hist(np.clip(plan.margin_before[plan.failed], *_SHOWN), edges, color=_RED, label="failed")
    above.set(yscale="log", ylabel="episodes")
    above.legend(frameon=False, loc="upper center", ncols=3)
    at = np.linspace(*_SHOWN, 200)
    below.plot(at, plan.risk().chance(at), color=_RED)
    middle, share, count = _shares(plan.margin[plan.fresh], plan.failed[plan.fresh], edges[::2])
    below.scatter(middle, share, s=4.0 + 2.0 * count, color=_BLUE, alpha=0.7, linewidths=0)
    more = f"; {STANDING:g} m more while the vehicle stands" if failure == "moving_collision" else ""
    below.set(xlabel=f"least margin in the rehearsal [{unit}]{more}", ylabel="share that fails", xlim=_SHOWN)
    below.set_ylim(bottom=-0.02)
    for axis in (above, below):
        axis.spines[["top", "right"]].set_visible(False)
    save_png(figure, path)


def _shares(margin: Any, failed: Any, edges: Any) -> tuple[Any, Any, Any]:
    """Return middle, share of failures and number of episodes of each bin that has any."""
    place = np.digitize(np.clip(margin, *_SHOWN), edges[1:-1])
    count = np.bincount(place, minlength=len(edges) - 1)
    hits = np.bincount(place, failed.astype(float), minlength=len(edges) - 1)
    some = count > 0
    return (0.5 * (edges[:-1] + edges[1:]))[some], hits[some] / count[some], count[some]
