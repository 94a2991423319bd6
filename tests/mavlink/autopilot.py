"""An autopilot that speaks MAVLink over UDP, in a process of its own: what the bridge talks to.

It knows pymavlink and nothing of zacoustic. On standard input it takes lines: `refuse TEXT` (the
next command is DENIED, and TEXT says why), `mute` (it acknowledges nothing), `speak`. On standard
output it prints one JSON object for each message that it gets, with its monotonic instant, s.
"""

import contextlib
import json
import select
import socket
import sys
import time
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega  # type: ignore[import-untyped]

SUBMARINE = 12
ARDUPILOT = 3
ARMED = 128


class Port:
    """A UDP port, as the generated code of pymavlink wants a file."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))

    def write(self, packet: bytes) -> None:
        with contextlib.suppress(ConnectionRefusedError):  # nobody there yet
            self.socket.send(packet)


class Autopilot:
    """ArduSub as far as a bridge can see it.

    Args:
        port: UDP port of the bridge on this computer.
    """

    def __init__(self, port: int) -> None:
        self.port = Port(port)
        self.mav: Any = ardupilotmega.MAVLink(self.port, srcSystem=7, srcComponent=1)
        self.mav.robust_parsing = True
        self.mode = 19
        self.is_armed = False
        self.refusal = ""
        self.is_mute = False
        self.interval_s: float | None = None
        self.beat_at = self.report_at = time.monotonic()
        self.started_at = time.monotonic()
        self.position = (-37_812_345, 1_449_631_234)

    def run(self) -> None:
        while True:
            ready, _, _ = select.select([self.port.socket, sys.stdin], [], [], 0.05)
            if sys.stdin in ready:
                line = sys.stdin.readline()
                if not line:
                    return
                self.order(line.strip())
            if self.port.socket in ready:
                self.read()
            self.speak()

    def read(self) -> None:
        try:
            data = self.port.socket.recv(65535)
        except ConnectionRefusedError:
            return
        for message in self.mav.parse_buffer(data) or ():
            self.take(message)

    def order(self, line: str) -> None:
        word, _, rest = line.partition(" ")
        self.is_mute = word == "mute"
        self.refusal = rest if word == "refuse" else ""

    def speak(self) -> None:
        now = time.monotonic()
        if now >= self.beat_at:
            self.beat_at = now + 1.0
            self.mav.heartbeat_send(SUBMARINE, ARDUPILOT, self.base_mode, self.mode, 4)
        if self.interval_s is not None and now >= self.report_at:
            self.report_at = now + self.interval_s
            self.report(now)

    @property
    def base_mode(self) -> int:
        return 1 | (ARMED if self.is_armed else 0)

    def report(self, now: float) -> None:
        north, east = self.position
        uptime_ms = int((now - self.started_at) * 1000)
        custom0 = self.base_mode - 256 if self.base_mode > 127 else self.base_mode
        self.mav.high_latency2_send(
            uptime_ms, SUBMARINE, ARDUPILOT, self.mode, north, east, -21, -20, 45, 46, 12, 33, 0, 0,
            6, 0, 0, 3, 4, 11, -2, 87, 5, 0x1000, custom0, 0, 0,
        )  # fmt: skip

    def take(self, message: Any) -> None:
        name = message.get_type()
        if name == "BAD_DATA":
            return
        head = {"from": message.get_srcSystem(), "at": time.monotonic()}
        print(json.dumps({**head, **message.to_dict()}), flush=True)
        if name in ("COMMAND_LONG", "COMMAND_INT"):
            self.execute(message)

    def execute(self, message: Any) -> None:
        if message.command == 511:
            self.interval_s = message.param2 / 1e6
            self.acknowledge(message, 0)
        elif self.is_mute:
            return
        elif self.refusal:
            self.mav.statustext_send(4, self.refusal.encode())
            self.acknowledge(message, 4)
        else:
            self.acknowledge(message, self.result(message))

    def result(self, message: Any) -> int:
        match message.command:
            case 400:
                self.is_armed = message.param1 == 1
            case 176:
                self.mode = int(message.param2)
            case 192:
                self.position, self.mode = (message.x, message.y), 4
            case 21:
                self.mode = 9
            case _:
                return 3
        return 0

    def acknowledge(self, message: Any, result: int) -> None:
        self.mav.command_ack_send(message.command, result)


if __name__ == "__main__":
    Autopilot(int(sys.argv[1])).run()
