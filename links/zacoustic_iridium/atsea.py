"""The link of a modem at sea, on a serial port or its emulation on TCP."""

import time

from zacoustic.bytestream import ByteStream
from zacoustic.core.clock import Clock
from zacoustic.core.linktypes import LinkState, TransmitOutcome
from zacoustic.errors import ConfigError
from zacoustic.link import LinkReceiver
from zacoustic.link.alarm import Alarm
from zacoustic_iridium.config import IridiumConfig
from zacoustic_iridium.link import IridiumLink
from zacoustic_iridium.modem import Arrived, Ended, Ready, SbdModem, Silent


class ModemLink(IridiumLink):
    """A 9602, 9603, RockBLOCK or similar.

    Args:
        name: `serial:PORT` or `tcp:HOST:PORT`.
        config: The settings.
        clock: Source of instants.

    Raises:
        ConfigError: The address is not valid, or there is no budget.
    """

    def __init__(
        self, name: str, config: IridiumConfig, *, clock: Clock = time.monotonic_ns
    ) -> None:
        super().__init__(name, config, clock=clock)
        if config.gateway or config.imei:
            raise ConfigError(f"iridium/{name}: gateway and imei are for directip:HOST:PORT")
        self._stream = ByteStream(name, baudrate=config.baudrate, clock=clock)
        self._modem = SbdModem(self._budget, give_up_s=config.give_up_s, check_s=config.check_s)
        self._alarm = Alarm(clock, lambda _: self._serve())

    async def open(self, receiver: LinkReceiver) -> None:
        """Begin to connect; raises LinkOpenError if it is open already."""
        await super().open(receiver)
        self._stream.open(self)

    async def close(self) -> None:
        """Release the port; report an outstanding frame as ABORTED."""
        self._alarm.stop()
        await super().close()
        self._modem.lost(self._clock())
        while self._modem.poll_event() is not None:
            pass
        await self._stream.close()

    def diagnostics(self) -> dict[str, int | float | str]:
        """Return counters, what was spent, and the signal."""
        return super().diagnostics() | {
            "signal_bars": -1 if self._modem.bars is None else self._modem.bars,
            "sessions": self._modem.sessions,
            "sessions_failed": self._modem.failed_sessions,
        }

    # Called by the stream

    def stream_opened(self) -> None:
        """The port has opened."""
        self._modem.connected(self._clock())
        self._serve()

    def bytes_received(self, data: bytes, received_at: int) -> None:
        """Bytes have come."""
        self._modem.received(data, received_at)
        self._serve()

    def stream_lost(self, reason: str) -> None:
        """The port is gone, or did not open."""
        state = LinkState.DOWN if self._state is LinkState.UP else self._state
        self._change_state(state, f"{reason}; tries again")
        self._modem.lost(self._clock())
        self._serve()

    # Below the methods above

    def _begin(self, frame_bytes: bytes, now: int) -> None:
        self._modem.send(frame_bytes, now)

    def _soon(self) -> None:
        self._alarm.set(self._clock())

    def _serve(self) -> None:
        """Do all that is due, then set the timer."""
        if self._receiver is None:
            return
        self._alarm.stop()
        self._flush()
        due_at = self._modem.poll_timeout()
        if due_at is not None and due_at <= self._clock():
            self._modem.timeout(self._clock())
        while (data := self._modem.poll_write()) is not None:
            self._stream.write(data)
        while (event := self._modem.poll_event()) is not None:
            match event:
                case Ready():
                    self._change_state(LinkState.UP, f"the modem at {self._name} answers")
                case Silent(reason):
                    state = LinkState.DOWN if self._state is LinkState.UP else self._state
                    self._change_state(state, f"the modem at {self._name}: {reason}; tries again")
                case Arrived(data, at):
                    self._hear(data, at)
                case Ended(is_sent, detail):
                    outcome = TransmitOutcome.SENT if is_sent else TransmitOutcome.ABORTED
                    self._finish(outcome, detail)
        self._flush()
        if self._receiver is not None:
            self._alarm.set(self._modem.poll_timeout())
