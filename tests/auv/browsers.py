"""The console with everything behind it, in real time, and a real browser in front of it."""

import contextlib
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
PHONE: Final = {"width": 390, "height": 844}


class Running:
    """`python -m examples.auv`, once its page is there."""

    def __init__(self, process: "subprocess.Popen[str]", port: int) -> None:
        self._process = process
        self.harmed: dict[int, str] = {}
        """What was harmed, and what may have lost its parent by that: command lines by ids."""
        self.address = f"http://127.0.0.1:{port}"

    @property
    def pid(self) -> int:
        """Of the process that serves the page."""
        return self._process.pid

    def children(self) -> dict[int, str]:
        """Return the processes that it has started: their command lines by their ids."""
        found: dict[int, str] = {}
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                words = (
                    (folder / "cmdline").read_bytes().decode(errors="replace").replace("\0", " ")
                )
            except OSError:  # it has ended meanwhile
                continue
            if parent == self.pid:
                found[int(folder.name)] = words
        return found

    def harm(self, pid: int, how: signal.Signals) -> None:
        """Kill or stop a process of it; all are ended behind the test."""
        self.harmed |= {**self.children(), pid: "the harmed one"}
        os.kill(pid, how)

    def child(self, words: str) -> int:
        """Return the id of the one process that it has started with such words."""
        (found,) = (pid for pid, command in self.children().items() if words in command)
        return found

    @property
    def rss_bytes(self) -> int:
        """Memory of the process that serves the page."""
        found = Path(f"/proc/{self._process.pid}/status").read_text(encoding="utf-8")
        line = next(line for line in found.splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) * 1024


@contextmanager
def console(*arguments: str, is_harmed: bool = False) -> Iterator[Running]:
    """Run everything; what was not wrong inside must also end as it should.

    Args:
        arguments: Of the command.
        is_harmed: Something of it is killed or stopped meanwhile.
    """
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
        running = Running(process, port)
        yield running
    finally:
        for pid in running.harmed:
            _end_harmed(pid, process.pid)
        for _ in range(2):  # somebody is impatient
            process.send_signal(signal.SIGINT)
        try:
            output, errors = process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    if is_harmed:
        return
    assert errors == "", errors
    assert output.endswith("stopped\n")
    assert process.returncode == 0


def _end_harmed(pid: int, server: int) -> None:
    """Wake one that was stopped; end one whose parent was killed."""
    with contextlib.suppress(ProcessLookupError, FileNotFoundError):
        os.kill(pid, signal.SIGCONT)
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8") if pid != server else ""
        if stat and int(stat.rpartition(")")[2].split()[1]) != server:
            os.kill(pid, signal.SIGKILL)


class Visitor:
    """One page of a browser, and everything that it has to complain about."""

    def __init__(self, browser: Any, address: str, viewport: dict[str, int] | None = None) -> None:
        self.problems: list[str] = []
        self._address = address
        self.page = browser.new_page(viewport=viewport or LAPTOP)
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("console", self._heard)
        self.page.on("request", self._asked)
        self.page.on("requestfailed", lambda request: self.problems.append(request.url))

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
            self.problems.append(said.text)

    def _asked(self, request: Any) -> None:
        """The page loads nothing from outside: there is no internet at sea."""
        if not request.url.startswith((self._address, "data:", "blob:")):
            self.problems.append(f"asked for {request.url}")


@contextmanager
def visit(
    running: Running, viewport: dict[str, int] | None = None, *, is_harmed: bool = False
) -> Iterator[tuple[Any, Visitor]]:
    """Open the page in a headless Chromium; gives the browser and the visitor.

    Args:
        running: Serves it.
        viewport: Size of the window.
        is_harmed: The browser may complain that it has lost its server.
    """
    api = pytest.importorskip("playwright.sync_api", reason="NOT RUN: no playwright")
    with api.sync_playwright() as tool:
        browser = tool.chromium.launch(
            executable_path=BROWSER, args=["--no-sandbox", "--enable-precise-memory-info"]
        )
        visitor = Visitor(browser, running.address, viewport)
        visitor.open()
        yield browser, visitor
        assert is_harmed or visitor.problems == []
        browser.close()
