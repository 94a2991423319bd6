"""The surfacing vehicle in processes of their own: water, satellite, two gateways, Zenoh clients.

Its log goes by radio at the surface, by sound below, and by satellite when it has lost its modem:
that process is killed. This script is the air between the aerials: it passes datagrams on, or not.

Run it: python examples/14_surfacing_processes.py
"""

import json
import queue
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import zenoh

SHORE, AUV = 1, 2
SCENARIO = {
    "profile": "evologics_s2c_18_34",
    "channel": "awgn",
    "nodes": [
        {"address": SHORE, "position": [0, 0, 10]},
        {"address": AUV, "position": [500, 0, 10]},
    ],
}
FLEET = {
    "nodes": [{"address": SHORE, "name": "shore"}, {"address": AUV, "name": "auv"}],
    "default_links": ["radio", "sound", "satellite"],
    "streams": [{"id": 1, "topic": "auv/log", "publishers": [AUV], "subscribers": [SHORE],
                 "reliability": "reliable", "depth": 50}],
}  # fmt: skip
BUDGET = "max_bytes_per_day=5000&price=0.16&session_s=1"  # for each link; emulated dollars


class Air:
    """Passes datagrams on between two aerials."""

    def __init__(self) -> None:
        self.is_clear = True
        self._ports = {each: free_port(socket.SOCK_DGRAM) for each in (SHORE, AUV)}
        self._sides = {}
        for here, there in ((SHORE, AUV), (AUV, SHORE)):
            side = self._sides[here] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            side.bind(("127.0.0.1", 0))
            threading.Thread(target=self._pass, args=(side, there), daemon=True).start()

    def radio(self, node: int) -> str:
        """Return the locator of the radio of a node."""
        host, port = self._sides[node].getsockname()
        return f"udp/127.0.0.1:{self._ports[node]}#peers={host}:{port}"

    def _pass(self, side: socket.socket, there: int) -> None:
        while datagram := side.recv(2048):
            if self.is_clear:
                side.sendto(datagram, ("127.0.0.1", self._ports[there]))


class Processes(ExitStack):
    """Processes that are killed at the end."""

    def start(self, *arguments: object) -> subprocess.Popen[str]:
        """Start zacoustic with a command, of which each line is JSON."""
        command = [sys.executable, "-m", "zacoustic", "run", *map(str, arguments), "--json"]
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
        )
        self.callback(process.wait)
        self.callback(process.kill)
        return process


def until(process: subprocess.Popen[str], event: str) -> dict[str, str]:
    """Read the lines of a process up to one about an event, and return that."""
    assert process.stdout is not None
    for line in process.stdout:
        told: dict[str, str] = json.loads(line)
        if told["event"] == event:
            return told
    raise RuntimeError(f"it has ended without the event {event}")


def main() -> None:
    with tempfile.TemporaryDirectory() as name, Processes() as processes:
        folder, local = Path(name), "127.0.0.1:0"
        (folder / "scenario.json5").write_text(json.dumps(SCENARIO))
        medium = processes.start("medium", folder / "scenario.json5", "--listen", local)
        directip, port = free_port(), {each: free_port() for each in (SHORE, AUV)}
        satellite = processes.start(
            *("modems", "iridium", "--modems", 1, "--listen", local, "--session", 0.2, 0.5),
            *("--shore", f"127.0.0.1:{directip}"),
        )
        sound = f"sim/{until(medium, 'listening')['address']}"
        modem, provider = until(satellite, "listening"), until(satellite, "directip")
        satellites = {
            SHORE: f"iridium/directip:127.0.0.1:{directip}#{BUDGET}"
            f"&gateway={provider['place']}&imei={modem['imei']}",
            AUV: f"iridium/{modem['locator']}#{BUDGET}",
        }
        air, gateways = Air(), []
        for each, locator in satellites.items():
            links = [
                {"name": "sound", "locator": sound},
                {"name": "radio", "locator": air.radio(each), "cost": "free", "down_after_s": 1},
                {"name": "satellite", "locator": locator, "cost": "money"},
            ]
            settings = {
                "mode": "router",
                "listen": {"endpoints": [f"tcp/127.0.0.1:{port[each]}"]},
                "scouting": {"multicast": {"enabled": False}},
                "plugins": {"acoustic": {"address": each, "links": links, **FLEET}},
            }
            (folder / f"{each}.json5").write_text(json.dumps(settings))
            gateways.append(processes.start("gateway", folder / f"{each}.json5"))
        for gateway in gateways:
            until(gateway, "started")
        lines: queue.Queue[str] = queue.Queue()
        with client(port[SHORE]) as shore, client(port[AUV]) as auv:
            shore.declare_subscriber("auv/log", lambda told: lines.put(told.payload.to_string()))
            log = auv.declare_publisher("auv/log")
            while not cast(Any, log.matching_status).matching:  # the gateway is not known there yet
                time.sleep(0.01)

            def report(text: str) -> str:
                began_s = time.monotonic()
                log.put(text)
                assert lines.get(timeout=60) == text
                took_s = time.monotonic() - began_s
                (reply,) = auv.get(f"@acoustic/{AUV}/bond/*")
                assert reply.ok is not None
                way: str = json.loads(reply.ok.payload.to_string())["in_use"]
                print(f"{text}: {took_s:.1f} s, by {way}")
                return way

            while report("at the surface") != "radio":
                time.sleep(1)
            air.is_clear = False
            report("it dives")
            assert report("below") == "sound"
            medium.kill()
            assert report("without its modem") == "satellite"
            air.is_clear = True
            while report("at the surface again") != "radio":
                time.sleep(1)
            assert lines.empty()


def client(port: int) -> zenoh.Session:
    settings = {"mode": "client", "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]}}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    main()
