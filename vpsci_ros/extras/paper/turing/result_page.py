"""The result of a Turing test as a page: Table 11 and Figure 10 beside the paper's values."""

from pathlib import Path
from typing import Any

import numpy as np

from vpsci_ros.extras.paper.published import ICC_2K
from vpsci_ros.extras.paper.turing.answers import Answers
from vpsci_ros.extras.paper.turing.clips import CONTROL, GENERATED, RECORDED, SOURCES
from vpsci_ros.extras.paper.turing.score import MARGIN, score
from vpsci_ros.report import html
from vpsci_ros.report.canvas import new_figure, save_png
from vpsci_ros.runs.files import require_empty_folder, write_json

PAGE, NUMBERS, FIGURE = "turing.html", "turing.json", "figure_10.png"
NAMES = {RECORDED: "recorded", GENERATED: "generated", CONTROL: "rule-based pair"}
_COLOURS = {RECORDED: "#08519c", GENERATED: "#b34700", CONTROL: "#777777"}


def write_result(answers: Answers, folder: Path) -> dict[str, Any]:
    """Write turing.html, turing.json and figure_10.png into `folder` and return the numbers.

    :raises InvalidInput: `folder` holds anything else.
    """
    require_empty_folder(folder, PAGE, NUMBERS, FIGURE)
    result = score(answers)
    write_json(folder / NUMBERS, result)
    save_figure(answers, folder / FIGURE)
    html.write_page(
        folder / PAGE,
        Path(__file__).resolve().parent / "templates" / "result.html",
        title="Turing test",
        result=result,
        names=NAMES,
        margin=MARGIN,
        published_icc=ICC_2K,
        figure=folder / FIGURE,
    )
    return result


def save_figure(answers: Answers, path: Path) -> None:
    """Draw Figure 10: the mean score of each clip, and how the scores of each source are spread."""
    figure, ((left, right),) = new_figure(10.0, 4.0, 1, 2, width_ratios=(2.0, 1.0))
    scenes = np.arange(answers.realism.shape[1])
    for i, source in enumerate(SOURCES):
        mean = answers.realism[..., i].mean(axis=0)
        left.bar(scenes + 0.27 * (i - 1), mean, 0.25, color=_COLOURS[source], label=NAMES[source])
    left.set_xticks(scenes, [str(scene + 1) for scene in scenes])
    left.set_xlabel("scene")
    left.set_ylabel("mean score, 1 to 5")
    left.set_ylim(1.0, 5.0)
    left.legend(fontsize=8)
    boxes = right.boxplot([answers.realism[..., i].ravel() for i in range(len(SOURCES))], patch_artist=True)
    for box, source in zip(boxes["boxes"], SOURCES, strict=True):
        box.set_facecolor(_COLOURS[source])
        box.set_alpha(0.5)
    right.set_xticklabels([NAMES[source] for source in SOURCES], fontsize=8)
    right.set_ylim(0.8, 5.2)
    save_png(figure, path)
