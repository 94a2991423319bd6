"""The console with everything behind it, in real time, and a real browser in front of it."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

ROOT: Final = Path(__file__).parents[2]
BROWSER: Final = shutil.which("chromium") or shutil.which("google-chrome")
LIMIT_MS: Final = 60_000
LAPTOP: Final = {"width": 1440, "height": 810}


class Running:
    """`python -m examples.auv`, once its page is there."""

    def __init__(self, process: "subprocess.Popen[str]", port: int) -> None:
        self._process = process
        self.address = f"http://127.0.0.1:{port}"

    @property
    def rss_bytes(self) -> int:
        """Memory of the process that serves the page."""
        found = Path(f"/proc/{self._process.pid}/status").read_text(encoding="utf-8")
        line = next(line for line in found.splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) * 1024


@contextmanager
def console(*arguments: str) -> Iterator[Running]:
    """Run everything; what was not wrong inside must also end as it should."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "examples.auv", "--port", str(port), *arguments]
    # NiceGUI takes a program that pytest has started for a test of its own.
    environment = {name: each for name, each in os.environ.items() if "PYTEST" not in name}
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert f"127.0.0.1:{port}" in process.stdout.readline()
        yield Running(process, port)
    finally:
        for _ in range(2):  # somebody is impatient
            process.send_signal(signal.SIGINT)
        try:
            output, errors = process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    assert errors == "", errors
    assert output.endswith("stopped\n")
    assert process.returncode == 0


class Visitor:
    """One page of a browser, and everything that it has to complain about."""

    def __init__(self, browser: Any, address: str) -> None:
        self.complaints: list[str] = []
        self._address = address
        self.page = browser.new_page(viewport=LAPTOP)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", self._heard)
        self.page.on("request", self._asked)
        self.page.on("requestfailed", lambda request: self.complaints.append(request.url))

    def open(self) -> None:
        """Load the page, as soon as somebody serves it."""
        for _ in range(100):
            try:
                with socket.create_connection(("127.0.0.1", int(self._address.rpartition(":")[2]))):
                    break
            except OSError:
                self.page.wait_for_timeout(100)
        self.page.goto(self._address, wait_until="load", timeout=LIMIT_MS)

    def see(self, text: str, *, limit_ms: float = LIMIT_MS) -> None:
        """Wait for a text."""
        from playwright.sync_api import Error

        try:
            self.page.get_by_text(re.compile(text)).first.wait_for(timeout=limit_ms)
        except Error:
            pytest.fail(f"{text} is not shown; the page has:\n{self.page.inner_text('body')}")

    def click(self, name: str) -> None:
        """Click on a button."""
        self.page.get_by_role("button", name=name, exact=True).click()

    def drag(self, slider: str, share: float) -> None:
        """Put a slider to a share of its way with the mouse."""
        box = self.page.locator(f'.q-slider[aria-label="{slider}"]').bounding_box()
        assert box is not None
        self.page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)

    def drawing(self, name: str) -> str:
        """Return a drawing as it is now."""
        found: str = self.page.locator(f'svg[aria-label="{name}"]').inner_html()
        return found

    def _heard(self, said: Any) -> None:
        if said.type in ("error", "warning"):
            self.complaints.append(said.text)

    def _asked(self, request: Any) -> None:
        """The page loads nothing from outside: there is no internet at sea."""
        if not request.url.startswith((self._address, "data:", "blob:")):
            self.complaints.append(f"asked for {request.url}")


@contextmanager
def visit(running: Running) -> Iterator[tuple[Any, Visitor]]:
    """Open the page in a headless Chromium; gives the browser and the visitor."""
    api = pytest.importorskip("playwright.sync_api", reason="NOT RUN: no playwright")
    with api.sync_playwright() as tool:
        browser = tool.chromium.launch(
            executable_path=BROWSER, args=["--no-sandbox", "--enable-precise-memory-info"]
        )
        visitor = Visitor(browser, running.address)
        visitor.open()
        yield browser, visitor
        assert visitor.complaints == []
        browser.close()
