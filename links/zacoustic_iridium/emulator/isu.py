"""One emulated SBD modem (ISU), without input and output: AT lines in, answers out, in its time."""

import random
from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic.core.clock import NS_PER_S
from zacoustic_iridium.config import MOST_RECEIVED_BYTES, MOST_SENT_BYTES
from zacoustic_iridium.directip import FromModem
from zacoustic_iridium.emulator.gateway import EmulatedGateway
from zacoustic_iridium.sbd import CHECK_BYTES, checked

_WRITE_LIMIT_NS: Final = 60 * NS_PER_S
_BARS: Final = 4
_BREAKS: Final = 18


class IsuFaults(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What goes wrong; shares of all sessions."""

    statuses: dict[int, float] = {}
    """Sessions that end with this status word, and have done nothing."""
    breaks_after: float = 0.0
    """Sessions that break off after the message is at the gateway: status 18."""
    mute: float = 0.0
    """Sessions that end without an answer, and have done nothing."""
    mute_after: float = 0.0
    """Sessions that have succeeded, and end without an answer."""


_NO_FAULTS: Final = IsuFaults()


def _nothing() -> None:
    """Do nothing."""


class EmulatedIsu:
    """A modem.

    Args:
        imei: Its number.
        gateway: Behind the satellites.
        rng: Draws durations and faults.
        session_s: Shortest and longest session, s.
        faults: What goes wrong.
    """

    def __init__(
        self,
        imei: str,
        gateway: EmulatedGateway,
        rng: random.Random,
        *,
        session_s: tuple[float, float] = (6.0, 30.0),
        faults: IsuFaults = _NO_FAULTS,
    ) -> None:
        self.imei = imei
        self._gateway = gateway
        self._rng = rng
        self._session_s = session_s
        self.faults = faults
        """What goes wrong; may be changed."""
        self.rang: Callable[[], None] = _nothing
        """Called when it has something to say by itself."""
        self._out: deque[bytes] = deque()
        self._number = 0
        self.restart()
        gateway.add(imei, self._ring)

    def restart(self) -> None:
        """Cut its power: buffers and settings are gone, its number stays."""
        self._input = bytearray()
        self._echoes, self._alerts, self._reports = True, False, False
        self._sent, self._received = b"", b""
        self._expected = 0
        self._write_until = 0
        self._session_at: int | None = None

    # Inputs

    def receive(self, data: bytes, now: int) -> None:
        """Take bytes of the host."""
        self._input += data
        while self._take_one(now):
            pass

    def timeout(self, now: int) -> None:
        """The instant of `poll_timeout` has come."""
        if self._session_at is not None and now >= self._session_at:
            self._session_at = None
            self._end_session()
        if self._expected and now >= self._write_until:
            self._expected = 0
            self._say("1", "OK")

    # Outputs

    def poll_write(self) -> bytes | None:
        """Return the next bytes for the host."""
        return self._out.popleft() if self._out else None

    def poll_timeout(self) -> int | None:
        """Return the instant of the next `timeout`, ns."""
        if self._expected:
            return self._write_until
        return self._session_at

    # Below the methods above

    def _take_one(self, now: int) -> bool:
        if self._expected:
            if len(self._input) < self._expected + CHECK_BYTES:
                return False
            whole = bytes(self._input[: self._expected + CHECK_BYTES])
            del self._input[: len(whole)]
            is_right = checked(whole[:-CHECK_BYTES]) == whole
            self._expected = 0
            if is_right:
                self._sent = whole[:-CHECK_BYTES]
            self._say("0" if is_right else "2", "OK")
            return True
        end = self._input.find(b"\r")
        if end < 0:
            del self._input[:-256]
            return False
        line = self._input[:end].decode("ascii", "replace").strip()
        del self._input[: end + 1]
        if self._echoes:
            self._out.append(line.encode() + b"\r")
        self._execute(line.upper(), now)
        return True

    def _execute(self, line: str, now: int) -> None:
        if self._session_at is not None:
            return  # it hears nothing while it talks to a satellite
        match line:
            case "":
                return
            case "AT" | "AT&K0":
                self._say("OK")
            case "ATE0" | "ATE1":
                self._echoes = line.endswith("1")
                self._say("OK")
            case "AT+SBDMTA=0" | "AT+SBDMTA=1":
                self._alerts = line.endswith("1")
                self._say("OK")
            case "AT+SBDD0" | "AT+SBDD2":
                self._sent = b""
                self._say("0", "OK")
            case "AT+SBDS":
                has = int(bool(self._sent)), self._number, int(bool(self._received)), 0
                self._say("+SBDS: " + ", ".join(map(str, has)), "OK")
            case "AT+SBDRB":
                size = len(self._received).to_bytes(2, "big")
                self._out.append(size + self._received + checked(self._received)[-CHECK_BYTES:])
                self._say("OK")
            case "AT+SBDIX" | "AT+SBDIXA":
                self._session_at = now + round(self._rng.uniform(*self._session_s) * NS_PER_S)
            case _ if line.startswith("AT+CIER="):
                self._reports = line.startswith("AT+CIER=1")
                self._say("OK")
                if self._reports:
                    self._say(f"+CIEV:0,{_BARS}")
            case _ if line.startswith("AT+SBDWB="):
                self._begin_write(line.removeprefix("AT+SBDWB="), now)
            case _:
                self._say("ERROR")

    def _begin_write(self, size: str, now: int) -> None:
        if not (size.isascii() and size.isdigit() and 1 <= int(size) <= MOST_SENT_BYTES):
            self._say("3", "OK")
            return
        self._expected, self._write_until = int(size), now + _WRITE_LIMIT_NS
        self._say("READY")

    def _end_session(self) -> None:
        status = self._draw_status()
        if status is None:
            return
        if not status and self._rng.random() < self.faults.breaks_after:
            self._hand_over()
            status = _BREAKS
        if status:
            self._report(status, self._number, 0, 0, 0, 0)
            return
        number = self._hand_over()
        self._number = (self._number + 1) & 0xFFFF
        if self._rng.random() < self.faults.mute_after:
            return
        taken = self._gateway.take(self.imei)
        if taken is None:
            self._report(0, number, 0, 0, 0, 0)
            return
        data, received_number = taken
        self._received = data[:MOST_RECEIVED_BYTES]
        waiting = self._gateway.waiting(self.imei)
        self._report(0, number, 1, received_number, len(self._received), waiting)

    def _draw_status(self) -> int | None:
        """Return a status word; None: the modem says nothing."""
        drawn = self._rng.random()
        for status, share in self.faults.statuses.items():
            drawn -= share
            if drawn < 0:
                return status
        return None if drawn < self.faults.mute else 0

    def _hand_over(self) -> int:
        self._gateway.accept(FromModem(self.imei, self._number, 0, self._sent))
        return self._number

    def _report(self, *words: int) -> None:
        self._say("+SBDIX: " + ", ".join(map(str, words)), "OK")

    def _ring(self) -> None:
        if self._alerts and self._session_at is None:
            self._say("SBDRING")
            self.rang()

    def _say(self, *lines: str) -> None:
        self._out.extend(b"\r\n" + line.encode() + b"\r\n" for line in lines)
