"""The questionnaire of the Turing test in a real browser: it asks all, keeps what was said, and saves it as a file."""

import json
from pathlib import Path
from typing import Any

import browser as real
import numpy as np
import pytest

from vpsci_ros.extras.paper.turing.clips import RatedClip
from vpsci_ros.extras.paper.turing.kit import write_questionnaire


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    t = np.arange(5) * 0.1
    motion = [np.column_stack([5.0 * t, 0 * t, 0 * t, 3.0 + k + 0 * t, t]) for k in range(3)]
    path = tmp_path_factory.mktemp("kit") / "questionnaire.html"
    write_questionnaire(path, "kit 1", [RatedClip(f"c{k}", 0, "", values) for k, values in enumerate(motion)])
    return path


def begin(page: Any, rater: str) -> None:
    page.fill("#rater", rater)
    page.keyboard.press("Enter")
    page.wait_for_selector("#answer:not([inert])")


def answer(page: Any, judgement: str, realism: int) -> None:
    page.wait_for_selector("#answer:not([inert])")
    page.check(f"[name=judgement][value={judgement}]")
    page.check(f"[name=realism][value='{realism}']")
    page.click("#next")


def test_answers_are_saved_as_a_file_with_judgement_and_realism(browser: Any, path: Path) -> None:
    with real.opened(browser, path, accept_downloads=True) as page:
        begin(page, "R / é <b>")
        for row in (("real", 5), ("made", 1), ("real", 3)):
            answer(page, *row)
        with page.expect_download() as download:
            page.click("#save")
        assert download.value.suggested_filename == "answers-R_é_b_.json"
        saved = json.loads(Path(download.value.path()).read_text(encoding="utf-8"))
    assert (saved["kit"], saved["rater"]) == ("kit 1", "R / é <b>")
    assert sorted(row["clip"] for row in saved["answers"]) == ["c0", "c1", "c2"]
    assert [(row["judgement"], row["realism"]) for row in saved["answers"]] == [("real", 5), ("made", 1), ("real", 3)]


def test_a_page_opened_again_goes_on_where_the_rater_stopped(browser: Any, path: Path) -> None:
    with real.opened(browser, path) as page:
        begin(page, "S")
        answer(page, "made", 2)
        page.wait_for_selector("#answer:not([inert])")
        page.reload()
        page.wait_for_selector("body[data-ready]")
        begin(page, "S")
        assert page.text_content("#progress") == "clip 2 of 3"
