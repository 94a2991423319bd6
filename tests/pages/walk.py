"""A reader who types what a page says, in its order, on one computer.

- Files of the page are in the folder. Ports of the loopback are exchanged for free ones, neighbours
  for neighbours; routers of a page find each other, but not those of another page. Where a page
  names a modem of a vessel, an emulated one stands in its place; where a file connects to a router,
  there is one.
- A verb that serves runs until `kill $(jobs -p)`; then it is interrupted, and has to end in peace.
  Every other command has to end with exit code 0, or with the one that its comment names.
- Of two gateways the second is on another computer: it listens elsewhere, unless it says where
  itself.
"""

import contextlib
import itertools
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.gateway.networks import zenoh_router
from tests.pages.blocks import ROOT, blocks_of, files_of, steps_of
from zacoustic.app.tools.demo.networks import free_ports

LIMIT_S: Final = 90.0
END: Final = "kill $(jobs -p)"
"""Ends what a page has started in the background."""
SERVING: Final = ("run", "dashboard", "monitor", "record")
"""Verbs that run until they are interrupted."""

_LOOPBACK_PORT: Final = re.compile(r"\b(127\.0\.0\.1|localhost):(\d{3,5})\b")
_MODEM: Final = re.compile(r"evologics/(tcp:(?!127|localhost)[\w.]+:\d+|serial:/dev/tty[A-Z]+\d)")
_MODEM_OF_NODE: Final = re.compile(rf"--address (\d+) (?:\\\n *)?--link '?{_MODEM.pattern}")
_IS_ROUTER: Final = re.compile(r'\bmode: "router",')
_ROUTER: Final = re.compile(r'connect: \{ endpoints: \["tcp/localhost:(\d+)"\] \}')


class Walk:
    """The way through one page.

    Args:
        page: Named from the root of the repository.
        folder: Where its files are written, and its commands run.
        part: Virtual time that a command asks for is divided by that.
    """

    def __init__(self, page: str, folder: Path, *, part: int = 1) -> None:
        self._part = part
        self._folder = folder
        self._page = page
        self._serving = contextlib.ExitStack()  # until the next heading
        self._stack = contextlib.ExitStack()  # until the end of the page
        self._gateways = 0
        self._said: list[tuple[str, list[str]]] = []
        texts = [*files_of(page).values(), *(block.text for block in blocks_of(page))]
        self._ports = _exchange(texts)
        self._scouting = f"224.0.0.224:{free_ports(1)[0]}"
        self._modems = self._emulated_modems("\n".join(texts))
        for router in dict.fromkeys(port for text in texts for port in _ROUTER.findall(text)):
            self._ports[int(router)] = self._stack.enter_context(zenoh_router())
        for name, text in files_of(page).items():
            path = folder / name.lstrip("/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self.moved(text), encoding="utf-8")

    def __enter__(self) -> "Walk":
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.rest()
        finally:
            self._stack.close()

    def go(self) -> None:
        """Type everything, section by section."""
        for _, section in itertools.groupby(blocks_of(self._page), key=lambda block: block.section):
            for block in section:
                if block.language == "sh":
                    self.do(block.text)
            self.rest()

    def rest(self) -> None:
        """End what serves."""
        serving, self._serving = self._serving, contextlib.ExitStack()
        self._gateways = 0
        serving.close()

    def moved(self, text: str) -> str:
        """Return a text with the places of this computer instead of the page's."""
        text = _LOOPBACK_PORT.sub(lambda found: f"{found[1]}:{self._ports[int(found[2])]}", text)
        # Routers of two pages, walked at once, would find each other by multicast.
        scouting = f'scouting: {{ multicast: {{ address: "{self._scouting}" }} }},'
        text = _IS_ROUTER.sub(lambda found: f"{found[0]} {scouting}", text)
        return _MODEM.sub(lambda found: f"evologics/{self._modems[found[1]]}", text)

    def do(self, block: str) -> list[str]:
        """Run the commands of a block of sh; returns the output of each that ended."""
        outputs = []
        for command, code in steps_of(block):
            background = command.endswith("&")
            if command == END:
                self.rest()
                continue
            words = self._shortened(shlex.split(self.moved(command.rstrip("&"))))
            if words[0] == "make":
                _check_target(words[1])
            elif background or _serves(words):
                self._serving.enter_context(self._served(words))
            else:
                outputs.append(self._done(words, code))
        return outputs

    def _shortened(self, words: list[str]) -> list[str]:
        return [
            str(float(word) / self._part) if before == "--until" else word
            for before, word in itertools.pairwise(["", *words])
        ]

    def _done(self, words: list[str], code: int) -> str:
        process = subprocess.run(
            _program(words),
            cwd=self._folder,
            env=_environment(),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
        said = f"{shlex.join(words)}: {process.returncode}\n{process.stdout}\n{process.stderr}"
        assert process.returncode == code, f"{said}\n{self._all_said()}"
        return process.stdout

    def _all_said(self) -> str:
        """What each command that serves, or has served, said: one of them may be the cause."""
        return "\n".join(f"{command}:\n{''.join(said)}" for command, said in self._said)

    @contextlib.contextmanager
    def _served(self, words: list[str], lines: int = 1) -> Iterator[list[str]]:
        """Run a command beside the others; it has said so many lines when this returns.

        A gateway has said all that it says at first: a reader looks at it before typing more.
        """
        if words[:3] == ["zacoustic", "run", "gateway"]:
            self._gateways += 1
            if self._gateways > 1 and "--listen" not in words:
                words = [*words, "--listen", f"tcp/127.0.0.1:{free_ports(1)[0]}"]
        process = subprocess.Popen(
            _program(words),
            cwd=self._folder,
            env=_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        said: list[str] = []
        self._said.append((shlex.join(words), said))
        spoken = threading.Semaphore(0)
        reader = threading.Thread(target=_read, args=(process, said, spoken), daemon=True)
        reader.start()
        try:
            while _serves(words) and not _is_ready(words, said, lines):
                assert spoken.acquire(timeout=LIMIT_S), f"{shlex.join(words)}: silent"
                assert process.poll() is None, f"{shlex.join(words)}: ended\n{''.join(said)}"
            yield said
            if process.poll() is None and _serves(words):
                process.send_signal(signal.SIGINT)
            code = process.wait(LIMIT_S)
            assert code == 0, f"{shlex.join(words)}: {code}\n{self._all_said()}"
        finally:
            if process.poll() is None:
                process.kill()
            process.wait()
            reader.join(LIMIT_S)
            assert process.stdout is not None
            process.stdout.close()

    def _emulated_modems(self, text: str) -> dict[str, str]:
        """Start a modem for each that the page names; returns where each is.

        It has the address of the node that the page puts on it, 1 where it does not say.
        """
        addresses = dict.fromkeys(_MODEM.findall(text), 1)
        addresses |= {name: int(address) for address, name in _MODEM_OF_NODE.findall(text)}
        if not addresses:
            return {}
        count = max(addresses.values())
        emulator = (
            f"zacoustic run modems evologics --modems {count} --listen 127.0.0.1:0 --pty --json"
        )
        said = self._stack.enter_context(self._served(shlex.split(emulator), lines=2 * count))
        locators = {
            (place["address"], place["locator"].partition(":")[0]): place["locator"]
            for place in map(json.loads, said[: 2 * count])
        }
        return {
            name: locators[address, name.partition(":")[0]] for name, address in addresses.items()
        }


def _read(process: "subprocess.Popen[str]", said: list[str], spoken: threading.Semaphore) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        said.append(line)
        spoken.release()
    spoken.release(1 << 10)  # who waits for a line of a process that has ended


def _serves(words: list[str]) -> bool:
    ends = {"--help", "--once", "demo"} & set(words)
    return words[0] == "zacoustic" and words[1] in SERVING and not ends


def _is_ready(words: list[str], said: list[str], lines: int) -> bool:
    if words[:3] == ["zacoustic", "run", "gateway"] and "--json" not in words:
        return any(line.startswith("digest") for line in said)
    return len(said) >= lines


def _program(words: list[str]) -> list[str]:
    match words:
        case ["zacoustic", *rest]:
            return [sys.executable, "-m", "zacoustic", *rest]
        case ["python", *rest]:
            return [sys.executable, *rest]
        case _:
            return words


def _environment() -> dict[str, str]:
    scripts = Path(sys.executable).parent
    path = f"{scripts}{os.pathsep}{os.environ.get('PATH', '')}"
    # NiceGUI takes a program that pytest has started for a test of its own.
    ours = {name: text for name, text in os.environ.items() if "PYTEST" not in name}
    return {**ours, "PATH": path, "PYTHONUNBUFFERED": "1"}


def _check_target(target: str) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert f"\n{target}:" in makefile, target


def _exchange(texts: list[str]) -> dict[int, int]:
    """Free ports for those of the texts, a run of neighbours for a run of neighbours."""
    used = sorted({int(port) for text in texts for _, port in _LOOPBACK_PORT.findall(text)})
    exchanged: dict[int, int] = {}
    while used:
        first = used[0]
        run = [port for index, port in enumerate(used) if port == first + index]
        base = _free_neighbours(len(run))
        exchanged |= {port: base + port - first for port in run}
        used = used[len(run) :]
    return exchanged


def _free_neighbours(count: int) -> int:
    """Return the first of so many ports in a row that nobody listens at."""
    for _ in range(1000):
        row = free_ports(count)
        if row[-1] - row[0] == count - 1:
            return row[0]
    raise AssertionError(f"no {count} free ports in a row")
