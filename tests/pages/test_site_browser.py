"""The built site and a report in a browser, from their folders; `make test-browser`."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from tests.axe import findings, source
from tests.pages.blocks import PAGES, ROOT
from tests.pages.walk import Walk

BROWSER: Final = shutil.which("chromium") or shutil.which("google-chrome")
SITE: Final = ROOT / "dist" / "site"
SHOWN: Final = {
    *("index", "tutorial", "comparison", "config", "howto/arrived", "api/node", "api/link"),
    *("api/console", "api/parts"),
}
"""One page of each kind; `make soak` looks at all."""
EVERY: Final = sorted(
    Path(page).relative_to("docs").with_suffix("").as_posix()
    for page in PAGES
    if page != "README.md"
)

pytestmark = [
    pytest.mark.skipif("ZACOUSTIC_BROWSER" not in os.environ, reason="make test-browser"),
    pytest.mark.skipif(BROWSER is None, reason="NOT RUN: no Chromium found"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason="NOT RUN: no playwright")
    with api.sync_playwright() as tool:
        running = tool.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield running
        running.close()


def test_axe_is_there_for_all_tests_that_look_for_barriers() -> None:
    if source() is None:
        pytest.skip("NOT RUN: npm cannot fetch axe-core, so no page was looked at for barriers")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in SHOWN else pytest.mark.soak, id=name)
        for name in EVERY
    ],
)
def test_nothing_on_the_site_is_a_serious_barrier_or_comes_from_elsewhere(
    browser: Any, name: str
) -> None:
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((SITE / f"{name}.html").as_uri(), wait_until="load")
    assert findings(page) == []
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    page.close()


def test_the_search_works_from_a_folder(browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.goto((SITE / "index.html").as_uri(), wait_until="load")
    page.get_by_role("textbox", name="Search").first.click()
    page.keyboard.type("min_interval_s")
    page.locator(".md-search-result__link").first.wait_for(timeout=30_000)
    page.close()


def test_nothing_in_a_report_is_a_serious_barrier(browser: Any, tmp_path: Path) -> None:
    with Walk("docs/tutorial.md", tmp_path):
        for words in (
            ["sim", "bay.json5", "--until", "600", "--record", "bay.mcap"],
            ["report", "bay.mcap", "--html", "bay.html"],
        ):
            subprocess.run(
                [sys.executable, "-m", "zacoustic", *words],
                cwd=tmp_path,
                check=True,
                capture_output=True,
            )
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.goto((tmp_path / "bay.html").as_uri(), wait_until="load")
    assert findings(page) == []
    page.close()
