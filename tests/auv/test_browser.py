"""The console in a real browser, with everything behind it in real time; `make test-browser`."""

import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[2]
BROWSER: Final = shutil.which("chromium") or shutil.which("google-chrome")
LIMIT_MS: Final = 60_000

pytestmark = [
    pytest.mark.skipif("ZACOUSTIC_BROWSER" not in os.environ, reason="make test-browser"),
    pytest.mark.skipif(BROWSER is None, reason="NOT RUN: no Chromium found"),
]


@contextmanager
def console() -> Iterator[str]:
    """Run `python -m examples.auv`; gives the address of its page."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "examples.auv", "--port", str(port)]
    # NiceGUI takes a program that pytest has started for a test of its own.
    environment = {name: each for name, each in os.environ.items() if "PYTEST" not in name}
    process = subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        assert "console is at" in process.stdout.readline()
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.communicate(timeout=60)


def test_sliders_move_the_vehicle_and_stop_stops_it() -> None:
    api = pytest.importorskip("playwright.sync_api", reason="NOT RUN: no playwright")
    complaints: list[str] = []
    with console() as address, api.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1180, "height": 820})
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else 0)
        for attempt in range(100):
            try:
                page.goto(address, wait_until="load", timeout=60_000)
                break
            except api.Error:  # it does not listen yet
                assert attempt < 99
                page.wait_for_timeout(200)

        def see(text: str) -> None:
            try:
                page.get_by_text(re.compile(text)).first.wait_for(timeout=LIMIT_MS)
            except api.Error:
                pytest.fail(f"{text} is not shown; the page has:\n{page.inner_text('body')}")

        see(r"auv1: disarmed")
        still = page.locator("svg[aria-label=map]").inner_html()
        page.get_by_role("button", name="arm", exact=True).click()
        see(r"arm: done")
        # Arrow keys on a slider would be rudder as well: a hand on a mouse.
        box = page.locator(".q-slider").nth(0).bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + 0.9 * box["width"], box["y"] + box["height"] / 2)
        see(r"auv1: manual")
        see(r", (0\.[5-9]|1\.)\d* m/s")
        moved = page.locator("svg[aria-label=map]").inner_html()
        assert moved != still
        page.get_by_label("depth m").fill("8")
        page.get_by_role("button", name="go to").click()
        see(r"accepted, under way")
        see(r"auv1: goto")
        if picture := os.environ.get("ZACOUSTIC_SCREENSHOT"):
            see(r"depth [4-9]\.\d m")
            page.screenshot(path=picture)
        page.get_by_role("button", name="STOP").click()
        see(r"auv1: stopped")
        see(r"the vehicle says that it has stopped")
        browser.close()
    assert complaints == []
