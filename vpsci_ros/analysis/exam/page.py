"""An exam's report as one HTML page that needs nothing beside it: what came out first, how to read it last."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.analysis import html
from vpsci_ros.analysis.exam import tables, texts
from vpsci_ros.analysis.exam.config import ALONE, LEARNED, TITLES
from vpsci_ros.analysis.exam.figures import save_episode, save_overview
from vpsci_ros.analysis.exam.measures import Drive
from vpsci_ros.analysis.exam.report import ADS, BASELINE
from vpsci_ros.world import Scenario


def write_page(
    path: Path,
    report: Mapping[str, Any],
    table: pl.DataFrame,
    drives: Mapping[str, list[Drive]],
    scenarios: Sequence[Scenario],
) -> None:
    """Write the page, and its pictures beside it: overview.png, episode.png.

    :param report: of `make_report`, with the keys exam, failures and criteria.
    :param table: a row an episode; `drives`: pedestrian -> episodes of the ADS, frame by frame.
    """
    ads = escape(report["exam"]["ads"])
    parts = [f"<h1>Exam of a driving system</h1><p class=small>{ads}</p>", _verdict(report)]
    if report["drivers"].get(ADS):
        overview = path.parent / "overview.png"
        save_overview(report, table, overview)
        parts += [_summary(report), html.image(overview, texts.OVERVIEW)]
        parts += [tables.scores(report, driver) for driver in report["drivers"]]
        parts += [tables.differences(report), tables.reliance(report), tables.conduct(report), tables.worst(table)]
        parts.append(_episode(path.parent / "episode.png", drives, scenarios))
    else:
        parts.append(tables.conduct(report))
    parts += [_reading(report), _provenance(report)]
    html.write_page(path, f"Exam of {report['exam']['ads']}", parts)


def _verdict(report: Mapping[str, Any]) -> str:
    if report["failures"]:
        lines = "".join(f"<li>{escape(text)}" for text in report["failures"])
        return f"<div class='verdict failed'><b>Failed</b><ul>{lines}</ul></div>"
    if not report["criteria"]:
        return "<div class='verdict open'><b>No criterion was given</b>, so nothing was judged (--fail-if).</div>"
    lines = "".join(
        f"<li>{escape(row['criterion'])}: {row['value']:.4g} with {escape(row['pedestrian'])}"
        for row in report["criteria"]
    )
    return f"<div class='verdict passed'><b>Passed</b>: no criterion for failing is met.<ul>{lines}</ul></div>"


def _summary(report: Mapping[str, Any]) -> str:
    """Return the result in a few sentences."""
    scores = report["drivers"][ADS]
    name = LEARNED if LEARNED in scores else next(iter(scores))
    row = scores[name]
    hit, moving, evaded = row["collision_rate"], row["moving_collision_rate"], row["evasion_success_rate"]
    text = f"""With the {TITLES[name]}, {_count(hit)} of {hit["n"]} episodes end in a contact: {_share(hit)}. In
        {_count(moving)} of them the vehicle moves. Of {evaded["n"]} critical episodes, {_share(evaded)} end without
        one. The ADS brakes hard in {_share(row["hard_braking_rate"])} of the episodes."""
    if row["time_lost"]["value"] is not None:
        lost = row["time_lost"]
        text += f" It loses {lost['value']:.2f} s on average [{lost['low']:.2f}, {lost['high']:.2f}]."
    if other := report["drivers"].get(BASELINE, {}).get(name):
        text += f" The rule-based autopilot has a contact in {_share(other['collision_rate'])} of these episodes."
    if found := report["reliance"].get(ADS):
        left, collide = found["left_to_pedestrian"], found["of_those_collide"]
        text += f""" Of the critical episodes that end well, {_share(left)} are settled by the pedestrian alone: it
            yields, the vehicle does not."""
        if collide["n"]:
            text += f""" Where the same pedestrian walks on, {_count(collide)} of these {collide["n"]} end with the
                vehicle hitting it."""
    return f"<p>{text} Brackets: 95% intervals.</p>"


def _episode(path: Path, drives: Mapping[str, list[Drive]], scenarios: Sequence[Scenario]) -> str:
    key = save_episode({name: found for name, found in drives.items() if name != ALONE}, scenarios, path)
    if key is None:
        return ""
    where = f"Scenario {key[0]}, episode {key[1]}: where the ADS came nearest to the learned pedestrian."
    return f"<h2>One episode, met by every pedestrian</h2><p>{where}</p>{html.image(path, texts.EPISODE)}"


def _reading(report: Mapping[str, Any]) -> str:
    rows = "".join(
        f"<li><b>{text['title']}</b> (<code>{name}</code>): {escape(text['definition'])}"
        for name, text in report["definitions"].items()
    )
    return f"<h2>How to read this</h2>{texts.READING}<ul>{rows}</ul>"


def _provenance(report: Mapping[str, Any]) -> str:
    exam = report["exam"]
    world, policy = exam["parameters"]["world_simulator"], exam["parameters"]["pedestrian_policy"]
    files = ", ".join(f"{name} {digest[:12]}" for name, digest in exam["ads_files_sha256"].items())
    rows = {
        "ADS": f"<code>{escape(exam['ads'])}</code>" + (f" ({escape(files)})" if files else ""),
        "episodes": f"seed {world.get('seed', 1)}, scenarios {world.get('scenarios', 'all')}",
        "learned pedestrian": f"{escape(str(policy['weights']))} ({exam['weights_sha256'][:12]})",
        "software": escape(", ".join(f"{name} {version}" for name, version in exam["software"].items())),
        "machine": escape(exam["cpu"]),
    }
    lines = "".join(f"<li>{name}: {text}" for name, text in rows.items())
    told = "In parentheses: SHA-256. All parameters: exam.json."
    return f"<h2>What was examined</h2><ul class=small>{lines}</ul><p class=small>{told}</p>"


def _share(found: Mapping[str, Any]) -> str:
    if found["value"] is None:
        return "none"
    value, low, high = (100.0 * found[key] for key in ("value", "low", "high"))
    return f"{value:.1f}% [{low:.1f}, {high:.1f}]"


def _count(found: Mapping[str, Any]) -> int:
    return round(found["value"] * found["n"]) if found["value"] is not None else 0
