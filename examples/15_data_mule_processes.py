"""The data mule in processes of their own: the water, three gateways, a Zenoh client at both ends.

The medium is told where the glider is: first beside the mooring, then beside the ship, which are
100 km apart. On the way the glider's gateway is killed: what it carries is in its journal.

Run it: python examples/15_data_mule_processes.py
"""

import json
import queue
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import zenoh

MOORING, GLIDER, SHIP = 1, 2, 3
NAMES = {MOORING: "mooring", GLIDER: "glider", SHIP: "ship"}
EAST_M = {MOORING: 0.0, GLIDER: 300.0, SHIP: 100_000.0}
SCENARIO = {
    "channel": "awgn",
    "nodes": [
        {"address": each, "position": [east, 0, 10], "profile": "evologics_s2c_18_34"}
        for each, east in EAST_M.items()
    ],
}
FLEET = {
    "nodes": [{"address": each, "name": name} for each, name in NAMES.items()],
    "streams": [
        {
            "id": 1, "topic": "mooring/log", "publishers": [MOORING], "subscribers": [SHIP],
            "reliability": "reliable", "journal": True, "depth": 100,
            # At sea a node that is not heard for five minutes is out of reach; here nobody waits.
            "carry": {"by": [GLIDER], "after_s": 3},
        },
        {"id": 2, "topic": "glider/here", "publishers": [GLIDER], "subscribers": [MOORING]},
    ],
}  # fmt: skip


class Processes(ExitStack):
    """Processes that are killed at the end."""

    def start(self, *arguments: object) -> subprocess.Popen[str]:
        """Start zacoustic with a command, of which each line is JSON."""
        command = [sys.executable, "-m", "zacoustic", "run", *map(str, arguments), "--json"]
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.callback(process.wait)
        self.callback(process.kill)
        return process


def until(process: subprocess.Popen[str], event: str) -> dict[str, object]:
    """Read the lines of a process up to one about an event, and return that."""
    assert process.stdout is not None
    for line in process.stdout:
        told: dict[str, object] = json.loads(line)
        if told["event"] == event:
            return told
    raise RuntimeError(f"it has ended without the event {event}")


def main() -> None:
    with tempfile.TemporaryDirectory() as name, Processes() as processes:
        folder = Path(name)
        (folder / "scenario.json5").write_text(json.dumps(SCENARIO))
        medium = processes.start(
            *("medium", folder / "scenario.json5", "--listen", "127.0.0.1:0", "--positions", "-"),
            *("--time-scale", 4),
        )
        link = f"sim/{until(medium, 'listening')['address']}"
        ports = {each: free_port() for each in NAMES}

        def gateway(address: int) -> subprocess.Popen[str]:
            return processes.start("gateway", folder / f"{address}.json5", "--link", link)

        for address, port in ports.items():
            settings = {
                "mode": "router",
                "listen": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
                "scouting": {"multicast": {"enabled": False}},
                "plugins": {"acoustic": {"address": address, "journal": name, **FLEET}},
            }
            (folder / f"{address}.json5").write_text(json.dumps(settings))
        gateways = {each: gateway(each) for each in NAMES}
        for each in gateways.values():
            until(each, "started")
        lines: queue.Queue[zenoh.Sample] = queue.Queue()
        with client(ports[MOORING]) as at_mooring, client(ports[SHIP]) as at_ship:
            at_ship.declare_subscriber("mooring/log", lines.put)
            here: queue.Queue[zenoh.Sample] = queue.Queue()
            at_mooring.declare_subscriber("glider/here", here.put)
            with client(ports[GLIDER]) as at_glider:
                put(at_glider, "glider/here", "beside the mooring")
                print(here.get(timeout=60).payload.to_string())
            put(at_mooring, "mooring/log", *(f"line {number}" for number in range(5)))
            for _ in range(5):
                told = until(gateways[MOORING], "custody")
                print(
                    f"{told['stream']} for {told['subscriber']}: in custody of {told['custodian']}"
                )

            gateways[GLIDER].kill()  # SIGKILL: it says and writes nothing any more
            gateways[GLIDER].wait()
            assert medium.stdin is not None
            beside_ship = {"address": GLIDER, "position": [EAST_M[SHIP] - 300.0, 0, 10]}
            print(json.dumps(beside_ship), file=medium.stdin, flush=True)
            gateway(GLIDER)
            heard = [lines.get(timeout=60).payload.to_string() for _ in range(5)]
            print("at the ship:", ", ".join(heard))
            assert heard == [f"line {number}" for number in range(5)]
            assert lines.empty()


def put(session: zenoh.Session, key: str, *values: str) -> None:
    publisher = session.declare_publisher(key)
    while not cast(Any, publisher.matching_status).matching:  # the gateway is not known there yet
        time.sleep(0.01)
    for value in values:
        publisher.put(value)


def client(port: int) -> zenoh.Session:
    settings = {"mode": "client", "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]}}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    main()
