"""The page in a real browser: one drives by keys, sees what came of it, and looks at the replay and the report."""

import threading
from contextlib import closing
from pathlib import Path
from typing import Any

from browser import wait_until

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.extras.drive.drive_page import Page
from vpsci_ros.extras.drive.person_exam import prepare_person, run_drive
from vpsci_ros.resources import params_dir


def test_one_drives_by_keys_and_sees_outcome_replay_and_report(browser: Any, tmp_path: Path) -> None:
    short = {"scenarios": [1], "episode_time": 6.0, "real_time_factor": 2.0}
    exam, factor = prepare_person(load(params_dir() / "drive.yaml").changed("world_simulator", short))
    said: list[str] = []
    failures: list[list[str]] = []
    tab = browser.new_context(viewport={"width": 1100, "height": 800})
    with closing(Page(tmp_path / "drive")) as server:
        driving = threading.Thread(target=lambda: failures.append(run_drive(exam, factor, tmp_path / "drive", server)))
        driving.start()
        page = tab.new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto(server.address)
        page.wait_for_selector("body[data-time='0']", timeout=600_000)  # compiling counts
        begins = page.inner_text("#readout")
        assert begins.startswith("0.00 s")
        page.keyboard.press("Enter")
        page.keyboard.down("ArrowUp")
        wait_until(page, "Number(document.body.dataset.time) > 1.5")
        faster = page.inner_text("#readout")
        assert page.is_hidden("#card")
        page.screenshot(path=tmp_path / "driving.png")
        page.keyboard.up("ArrowUp")
        page.keyboard.down("s")
        wait_until(page, "document.body.dataset.outcome")
        braked = page.inner_text("#readout")
        replay = page.get_attribute("#links a", "href")
        wait_until(page, "document.body.dataset.ended")
        assert page.inner_text("#headline") == "1 episode driven"
        page.screenshot(path=tmp_path / "ended.png")
        links = [each.get_attribute("href") for each in page.query_selector_all("#links a")]
        assert links == ["report.html", "view.html"]
        for address, expected in (
            (replay, "Episode 1:0"),
            (links[0], "Exam of a driving system"),
            (links[1], "Exam of you"),
        ):
            page.goto(server.address + address)
            assert expected in page.inner_text("h1")
        tab.close()
        driving.join(60.0)
    assert failures == [[]]
    speed = [int(text.split(" · ")[1].removesuffix(" km/h")) for text in (begins, faster, braked)]
    assert speed[1] > speed[0] + 3, "the accelerator was pressed"
    assert speed[2] < speed[1], "then the brake"
    assert said == []
