"""The questionnaire, one HTML file for the raters, and its key, which they must not see."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.documents import read_json
from vpsci_ros.evaluation.onsets import Onsets
from vpsci_ros.extras.paper.turing.clips import RatedClip, draw_scenes, make_clips
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.report import html
from vpsci_ros.resources import near_misses_path, weights_path
from vpsci_ros.runs.files import require_empty_folder, sha256, write_json
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.view.view_page import SCENE, inlined
from vpsci_ros.world.observation import STEP

PAGE, KEY = "questionnaire.html", "key.json"
TEMPLATES = Path(__file__).resolve().parent / "templates"


def make_kit(table: Path, weights: str, folder: Path, *, scenes: int, seed: int) -> dict[str, Any]:
    """Write questionnaire.html and key.json into `folder` and return the key.

    :param table: near misses of recorded people, or a part of them, see `read_near_misses`.
    :param weights: of the policies to be rated: a file, or the name of shipped ones.
    :param scenes: each makes three clips; at least 2.
    :raises InvalidInput: table or weights are refused, the folder holds anything but the same kit, or there are too few
        scenes.
    """
    rows = read_near_misses(table)
    path = weights_path(weights)
    loaded = load_policy(path)
    onsets = draw_scenes(rows, scenes, seed)
    clips = make_clips(onsets, loaded, seed)
    shown = [{"name": clip.name, "values": clip.values.round(3).tolist()} for clip in clips]
    kit = hashlib.sha256(json.dumps(shown).encode()).hexdigest()[:16]
    key = {
        "kit": kit,
        "seed": seed,
        "near_misses_sha256": sha256(near_misses_path(table)),
        "weights": weights,
        "weights_sha256": sha256(path),
        "scenes": _scenes(onsets, loaded.facts.get("data", {}).get("held_out_clips", [])),
        "clips": {clip.name: {"scene": clip.scene, "source": clip.source} for clip in clips},
        "software": software_versions(),
    }
    if (folder / KEY).is_file():
        require_same(folder / KEY, read_json(folder / KEY), key, "holds a kit")  # whose files are written once more
    else:
        require_empty_folder(folder)
    write_questionnaire(folder / PAGE, kit, clips)
    write_json(folder / KEY, key)
    return key


def write_questionnaire(path: Path, kit: str, clips: Sequence[RatedClip]) -> None:
    """Write the page for the raters: the clips by name, without their sources."""
    html.write_page(
        path,
        TEMPLATES / "questionnaire.html",
        kit=kit,
        clips=[{"name": clip.name, "values": clip.values.round(3).tolist()} for clip in clips],
        period=STEP,
        size=[VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS],
        style=inlined("view.css") + (TEMPLATES / "questionnaire.css").read_text(encoding="utf-8"),
        script=inlined(*SCENE) + (TEMPLATES / "questionnaire.js").read_text(encoding="utf-8"),
    )


def _scenes(onsets: Onsets, held_out: Sequence[str]) -> list[dict[str, Any]]:
    return [
        {"interaction": int(number), "recording": str(clip), "held_out": str(clip) in held_out}
        for number, clip in zip(onsets.number, onsets.clip, strict=True)
    ]
