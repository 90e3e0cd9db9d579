"""The Foxglove layout shows topics that exist and fields that their messages have."""

import json
import re
from pathlib import Path

from vpsci_ros.nodes.topics import TOPICS

LAYOUT = json.loads((Path(__file__).resolve().parents[2] / "docs" / "foxglove_layout.json").read_text())


def panels(node: dict | str) -> list[str]:
    return [node] if isinstance(node, str) else panels(node["first"]) + panels(node["second"])


def test_every_panel_is_configured_and_every_configuration_is_shown() -> None:
    assert sorted(panels(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


def test_every_path_leads_to_a_field_of_a_topic() -> None:
    paths = [path["value"] for panel in LAYOUT["configById"].values() for path in panel.get("paths", [])]
    assert len(paths) == 5
    for path in paths:
        topic, *fields = re.sub(r"\[\d+\]", "", path).split(".")
        message = TOPICS[topic].type()
        for field in fields:
            message = getattr(message, field)


def test_the_scene_shows_topics_of_the_graph() -> None:
    assert set(LAYOUT["configById"]["3D!world"]["topics"]) <= set(TOPICS)
