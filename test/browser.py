"""A real browser for tests of pages: the system's, Playwright's own or the one that CHROMIUM names."""

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NO_BROWSER = "no Chromium on the PATH; CHROMIUM names one elsewhere"


def start() -> Iterator[Any]:
    """Yield a running browser; skips the test where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="no Playwright; pip install -e '.[test]'")
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    found = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, names)), None)
    with playwright.sync_playwright() as driver:
        found = found or driver.chromium.executable_path
        if not Path(found).exists():
            pytest.skip(NO_BROWSER)
        browser = driver.chromium.launch(executable_path=found, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


@contextmanager
def opened(browser: Any, path: Path, address: str = "", **context: Any) -> Iterator[Any]:
    """Open a file from disk, without a network, until the block ends; a word on its console fails the test."""
    said: list[str] = []
    tab = browser.new_context(**{"offline": True, "viewport": {"width": 1300, "height": 850}} | context)
    page = tab.new_page()
    page.set_default_timeout(120_000)
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: request.url.startswith(("file:", "blob:", "data:")) or said.append(request.url))
    page.goto(path.as_uri() + address)
    page.wait_for_selector("body[data-ready]")
    yield page
    tab.close()
    assert said == []


def wait_until(page: Any, expression: str) -> None:
    """Wait until JavaScript holds on a page; Playwright's own way needs `eval`, which pages forbid."""
    deadline = time.monotonic() + 60.0
    while not page.evaluate(expression):
        assert time.monotonic() < deadline, f"waited 60 s for {expression}"
        page.wait_for_timeout(20)
