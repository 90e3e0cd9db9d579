"""The datasheet of a generated dataset: what it holds, how it was made, where its limits are, in its own numbers.

It is the folder's README.md, and begins with what dataset hubs read: licence, files by scenario and split, columns.
"""

from collections.abc import Mapping
from typing import Any

from vpsci_ros.data.dataset_files import DATASET_COLUMNS
from vpsci_ros.data.dataset_index import REJECTED
from vpsci_ros.data.filters import REASONS
from vpsci_ros.data.published import LEAST_CURVTTC, TABLE_10
from vpsci_ros.documents import dump_yaml

LICENCE = "apache-2.0"  # that of the package and of the weights it ships; who publishes a dataset may choose another


def datasheet(description: Mapping[str, Any]) -> str:
    """Return the datasheet as Markdown.

    :param description: content of dataset.json.
    """
    rows = description["scenarios"]
    return (
        "\n\n".join(
            [
                f"---\n{dump_yaml(_card(description))}---",
                "# Vehicle-pedestrian safety-critical interactions, simulated",
                _what(description),
                _table(rows),
                _columns(description),
                _how(description),
                _selection(rows, description),
                _limits(description),
                _use(next(iter(rows))),
            ]
        )
        + "\n"
    )


def _card(description: Mapping[str, Any]) -> dict[str, Any]:
    """Return the front matter: a configuration a scenario, with the splits `kept` and, where they are, `rejected`."""
    names = list(description["scenarios"])
    columns = [{"name": name, "dtype": str(column.dtype).lower()} for name, column in DATASET_COLUMNS.items()]
    configs, info = [], []
    for name in names:
        splits = {
            split: (path, description["files"][path])
            for split, path in (("kept", f"{name}.parquet"), ("rejected", f"{REJECTED}/{name}.parquet"))
            if path in description["files"]
        }
        files = [{"split": split, "path": path} for split, (path, _) in splits.items()]
        counts = [
            {"name": split, "num_bytes": entry["bytes"], "num_examples": entry["rows"]}
            for split, (_, entry) in splits.items()
        ]
        if splits:
            configs.append({"config_name": name, "data_files": files})
            info.append({"config_name": name, "features": columns, "splits": counts})
    return {
        "license": LICENCE,
        "pretty_name": "Vehicle-pedestrian safety-critical interactions, simulated",
        "tags": ["trajectories", "automated driving", "pedestrians", "simulation"],
        "configs": configs,
        "dataset_info": info,
    }


def _what(description: Mapping[str, Any]) -> str:
    rows = description["scenarios"].values()
    kept, km = sum(row["kept"] for row in rows), sum(row["vehicle_km"] for row in rows)
    return (
        "## What\n\n"
        f"{kept:,} episodes of one car turning right and one pedestrian crossing, in {len(rows)} scenarios, a frame "
        f"every {description['period']:g} s: {km:,.1f} km of vehicle and "
        f"{sum(row['pedestrian_km'] for row in rows):,.1f} km of pedestrian trajectories. Both road users are learned "
        "policies from the moment a collision is near (CurvTTC below "
        f"{description['configuration']['safety_monitor']['critical_threshold']:g} s) and rule-based before. "
        "No person and no real vehicle is in it."
    )


def _table(rows: Mapping[str, Any]) -> str:
    lines = [
        "| scenario | kept | paper | simulated | accepted | vehicle km | per episode | pedestrian km | per episode |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for name, row in rows.items():
        kept = row["kept"]
        published = TABLE_10.get(row["number"])
        lines.append(
            f"| {name} | {kept:,} | {f'{published.kept:,}' if published else '-'} | {row['simulated']:,} "
            f"| {row['acceptance_rate']:.1%} | {row['vehicle_km']:,.1f} | {1000 * row['vehicle_km'] / kept:.1f} m "
            f"| {row['pedestrian_km']:,.1f} | {1000 * row['pedestrian_km'] / kept:.1f} m |"
        )
    return "\n".join(lines)


def _columns(description: Mapping[str, Any]) -> str:
    lines = []
    for name, column in description["columns"].items():
        unit = f" [{column['unit']}]" if column["unit"] else ""
        lines.append(f"- `{name}`{unit}: {column['description']}")
    return (
        "## Columns\n\n"
        "Positions and velocities are in the map frame: x east, y north (CARLA's y is -y). `CurvTTC` is infinite where "
        "no contact is predicted within the horizon. `episodes.parquet` has a row for each simulated episode, rejected "
        "ones too, with the reason.\n\n" + "\n".join(lines)
    )


def _how(description: Mapping[str, Any]) -> str:
    weights = "; ".join(
        f"{agent}: {entry['name']}, SHA-256 `{entry['sha256'][:16]}`" for agent, entry in description["weights"].items()
    )
    return (
        "## How\n\n"
        f"Simulated by vpsci_ros {description['versions']['vpsci_ros']} with seed {description['seed']} on "
        f"{description['cpu']}; policies: {weights or 'none, both road users are rule-based'}. Each episode is a pure "
        "function of (seed, scenario, number, weights), to the bit on one kind of CPU. `dataset.json` holds the whole "
        "configuration and the hash of every file, and the weights lie beside it, so that "
        "`vpsci dataset verify` can simulate any row again."
    )


def _selection(rows: Mapping[str, Any], description: Mapping[str, Any]) -> str:
    counts, filters, total = rows.values(), description["filters"], description["all"]
    simulated = sum(row["simulated"] for row in counts)
    lines = ["| rejected, by the first condition that fails | episodes | share | of them collisions |"]
    lines.append("|---|---:|---:|---:|")
    for reason in REASONS[1:]:
        rejected = sum(row["rejected"][reason] for row in counts)
        collisions = sum(row["rejected_collisions"][reason] for row in counts)
        lines.append(f"| {reason} | {rejected:,} | {rejected / simulated:.1%} | {collisions:,} |")
    kept = sum(row["kept"] for row in counts)
    collided = sum(row["kept_outcomes"]["collision"] for row in counts)
    early = total["with_early_collisions"]
    seconds = filters["least_frames"] * description["period"]
    return (
        f"## Selection\n\n{simulated:,} episodes were simulated, {kept:,} kept.\n\n" + "\n".join(lines) + "\n\n"
        f"A collision ends its episode, so the condition of {filters['least_frames']} frames drops every collision "
        f"before {seconds:g} s. With it {collided:,} of {kept:,} kept episodes ({collided / kept:.2%}) are collisions "
        f"and the quartiles of the least CurvTTC are {_seconds(total['least_curvttc'])}. With those early collisions "
        f"put back, which pass every other condition, {early['collisions']:,} of {early['kept']:,} "
        f"({early['collisions'] / early['kept']:.2%}) are, and the quartiles are {_seconds(early['least_curvttc'])}. "
        f"The paper's are {_seconds(LEAST_CURVTTC)}."
    )


def _limits(description: Mapping[str, Any]) -> str:
    least = description["filters"]["least_frames"]
    return (
        "## Limits\n\n"
        "- One vehicle of one type and one pedestrian; no other traffic, signals, weather or occlusion.\n"
        "- The vehicle is a kinematic bicycle, the pedestrian a disc; neither slips, falls or tires.\n"
        "- Behaviour in danger is what the policies learned; it is as good as their errors on held-out near misses "
        "(model card of the weights), and says nothing of other places or people.\n"
        f"- Rates of collision are those of the selection above, which leaves out episodes under {least} frames. They "
        "are not accident statistics.\n"
        "- On another kind of CPU the last bits of an episode may differ, and a collision that is a near miss by a "
        "hair there stays one."
    )


def _use(name: str) -> str:
    return (
        "## Use\n\n```python\nimport pandas\n\n"
        f'rows = pandas.read_parquet("{name}.parquet")\n'
        'least = rows.groupby("count")["CurvTTC"].min()\n```'
    )


def _seconds(quartiles: Any) -> str:
    return ", ".join(f"{value:.2f}" for value in quartiles) + " s"
