"""The datasheet of a generated dataset, its README.md: content, origin and limits, with the dataset's numbers.

Its words are in `templates/datasheet.md`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

from vpsci_ros.data.episode_block import REASONS
from vpsci_ros.data.published import LEAST_CURVTTC, TABLE_10
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world import Scenario

_TEMPLATES = Path(__file__).resolve().parent / "templates"
_NUMBERS = ("", "one", "two", "three", "four", "five", "six", "seven", "eight")


def datasheet(description: Mapping[str, Any], scenarios: Sequence[Scenario]) -> str:
    """Return the datasheet as Markdown.

    :param description: content of dataset.json.
    :param scenarios: of the dataset.
    """
    rows, configuration = description["scenarios"], description["configuration"]
    several = int(configuration["world_simulator"]["pedestrians"])
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("datasheet.md").render(
        d=description,
        rows=rows,
        kept=sum(row["kept"] for row in rows.values()),
        simulated=sum(row["simulated"] for row in rows.values()),
        collided=sum(row["kept_outcomes"]["collision"] for row in rows.values()),
        early=description["all"]["with_early_collisions"],
        right_turns=all(row["number"] in TABLE_10 for row in rows.values()),
        people="one pedestrian" if several == 1 else f"one to {_NUMBERS[several]} pedestrians",
        several=several > 1,
        parked=[scenario.name for scenario in scenarios if len(scenario.parked)],
        drivers=_drivers("All" if several > 1 else "Both", description["weights"]),
        reasons=REASONS[1:],
        table_10=TABLE_10,
        published=LEAST_CURVTTC,
        critical=CRITICAL_TTC,
        number="{:,}".format,
        seconds=lambda quartiles: ", ".join(f"{value:.2f}" for value in quartiles) + " s",
    )


def _drivers(everybody: str, weights: Mapping[str, Mapping[str, Any]]) -> str:
    """Return in words which agents act by which bank or weights while CurvTTC is critical."""
    if not weights:
        return f"{everybody} road users are rule-based"
    act = f"{everybody} road users act" if len(weights) > 1 else f"The {next(iter(weights))} acts"
    names = dict.fromkeys(f"`{entry['name']}`" for entry in weights.values())
    return f"{act} by {' and '.join(names)}"
