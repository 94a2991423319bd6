"""The link to an S2C modem: moves bytes between the port and the dialogue, and arms one timer."""

import asyncio
import time
from collections.abc import Iterator, Mapping
from typing import Any, Self, assert_never

from zacoustic.bytestream import ByteStream
from zacoustic.core.clock import Clock
from zacoustic.core.linktypes import LinkState, Transmission
from zacoustic.errors import ConfigError, LinkClosedError, LinkOpenError
from zacoustic.link import Finding, Link, LinkConfig, LinkReceiver, LoggedFrame
from zacoustic.link.alarm import Alarm
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.dialogue import AtDialogue
from zacoustic_evologics.driver.events import (
    CarrierChanged,
    ConnectionUseless,
    Event,
    FrameHeard,
    LinkChanged,
    Measured,
    OpeningHopeless,
    TransmissionEnded,
)
from zacoustic_evologics.examination import assess, examine
from zacoustic_evologics.portlog import read_port_log


class EvologicsLink(Link):
    """EvoLogics S2C modem; evologics/serial:PORT#baudrate=19200 or evologics/tcp:HOST:9200.

    Args:
        stream: The port, not open yet.
        config: Settings of the driver.
        node_address: Acoustic address of this node, 1…254.
        clock: Source of instants, the same as the stream's.
    """

    config_type = EvologicsConfig

    def __init__(
        self,
        stream: ByteStream,
        config: EvologicsConfig | None = None,
        *,
        node_address: int,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        self._stream = stream
        self._config = config or EvologicsConfig()
        self._clock = clock
        self._node_address = node_address
        self._now = 0
        is_serial = stream.address.startswith("serial:")
        self._dialogue = AtDialogue(self._config, node_address=node_address, is_serial=is_serial)
        self._receiver: LinkReceiver | None = None
        self._opened: asyncio.Future[None] | None = None
        self._alarm = Alarm(clock, self._expire)
        self._is_servicing = False
        self._service_pending = False
        self.capabilities = self._dialogue.capabilities

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        """Build the link to the modem at `serial:PORT` or `tcp:HOST:PORT`.

        Raises:
            ConfigError: The address is neither, or the node address is outside 1…254.
        """
        assert isinstance(config, EvologicsConfig)
        if not 1 <= node_address <= 254:
            raise ConfigError(f"node address is {node_address}; allowed: 1..254")
        stream = ByteStream(address, baudrate=config.baudrate)
        return cls(stream, config, node_address=node_address)

    async def open(self, receiver: LinkReceiver) -> None:
        """Connect and make the modem ready; waits up to `wait_s` for it.

        Raises:
            LinkOpenError: The port cannot be opened or the modem does not answer in time, or it
                cannot serve this node.
        """
        if self._receiver is not None:
            raise LinkOpenError(f"{self._stream.address} is open already")
        self._receiver = receiver
        self._opened = asyncio.get_running_loop().create_future()
        receiver.state_changed(LinkState.OPENING, f"connecting to {self._stream.address}")
        self._stream.open(self)
        try:
            async with asyncio.timeout(self._config.wait_s):
                await self._opened
        except TimeoutError as error:
            detail = self._dialogue.detail
            await self.close()
            raise LinkOpenError(
                f"no modem at {self._stream.address} within {self._config.wait_s:g} s: {detail}"
            ) from error
        except BaseException:
            await self.close()
            raise
        finally:
            self._opened = None

    async def close(self) -> None:
        """Release the port; before that report an outstanding frame as ABORTED."""
        # First without a receiver: a report may cause another `transmit`, which must fail.
        receiver, self._receiver = self._receiver, None
        if receiver is not None:
            self._dialogue.close(self._instant())
            while (event := self._dialogue.poll_event()) is not None:
                if isinstance(event, TransmissionEnded):
                    receiver.transmit_finished(event.report)
        self._alarm.stop()
        await self._stream.close()

    def transmit(self, transmission: Transmission) -> None:
        """Give a frame to the modem.

        Raises:
            LinkClosedError: Not open.
        """
        if self._receiver is None:
            raise LinkClosedError(f"{self._stream.address} is not open")
        self._dialogue.transmit(transmission, self._instant())
        if not self._is_servicing:
            self._write()
            self._arm()
            self._service_later()

    def diagnostics(self) -> dict[str, int | float | str]:
        """Return the state of the dialogue, readings of the modem, counters of the port."""
        stream = self._stream
        return {
            **self._dialogue.diagnostics(),
            "bytes_read": stream.bytes_read,
            "bytes_written": stream.bytes_written,
            "connections": stream.connections,
        }

    async def examine(self, patience_s: float) -> list[Finding]:
        """Query the modem without changing it; on a serial port also at other baud rates."""
        return await examine(self._stream.address, self._config, self._node_address, patience_s)

    def assess(self, health: Mapping[str, Any]) -> list[Finding]:
        """Find faults in the modem's values in a running gateway's health report."""
        return assess(health, self._config)

    @classmethod
    def read_log(cls, log: bytes) -> Iterator[LoggedFrame]:
        """Find the frames in a log of the port, both sent and received."""
        return read_port_log(log)

    # Called by the stream

    def stream_opened(self) -> None:
        """Note a connection."""
        self._dialogue.handle_opened(self._instant())
        self._service()

    def bytes_received(self, data: bytes, received_at: int) -> None:
        """Take bytes of the modem."""
        self._now = max(self._now, received_at)
        self._dialogue.handle_bytes(data, self._now)
        self._service()

    def stream_lost(self, reason: str) -> None:
        """Note that the connection was lost, or could not be made."""
        self._dialogue.handle_lost(reason, self._instant())
        self._service()

    # Driving the dialogue

    def _service(self) -> None:
        """Write, report, arm the timer."""
        self._service_pending = False
        if self._is_servicing or self._receiver is None:
            return
        self._is_servicing = True
        try:
            self._write()
            while (event := self._dialogue.poll_event()) is not None:
                self._tell(event)
                self._write()
        finally:
            self._is_servicing = False
        self._arm()

    def _service_later(self) -> None:
        """Report pending events after `transmit` has returned."""
        if not self._service_pending:
            self._service_pending = True
            asyncio.get_running_loop().call_soon(self._service)

    def _write(self) -> None:
        while (output := self._dialogue.poll_output()) is not None:
            if not self._stream.write(output):
                self._stream.reset("the modem takes no more bytes")

    def _tell(self, event: Event) -> None:
        receiver = self._receiver
        if receiver is None:
            return
        match event:
            case FrameHeard():
                receiver.frame_received(event.frame)
            case TransmissionEnded():
                receiver.transmit_finished(event.report)
            case CarrierChanged():
                receiver.carrier_changed(event.busy)
            case Measured():
                receiver.measured(event.measurement)
            case LinkChanged():
                if event.capabilities is not None:
                    self.capabilities = event.capabilities
                receiver.state_changed(event.state, event.detail)
                if event.state is LinkState.UP:
                    self._settle(None)
            case ConnectionUseless():
                self._stream.reset(event.reason)
            case OpeningHopeless():
                self._settle(
                    LinkOpenError(f"{self._stream.address}: {event.reason}", hint=event.hint)
                )
            case _:
                assert_never(event)

    def _settle(self, error: LinkOpenError | None) -> None:
        """End the wait of `open`."""
        if self._opened is None or self._opened.done():
            return
        if error is None:
            self._opened.set_result(None)
        else:
            self._opened.set_exception(error)

    def _arm(self) -> None:
        """Set the one timer to the dialogue's next due instant."""
        self._alarm.set(None if self._receiver is None else self._dialogue.poll_timeout())

    def _expire(self, due_at: int) -> None:
        self._now = max(self._instant(), due_at)
        self._dialogue.handle_timeout(self._now)
        self._service()

    def _instant(self) -> int:
        """Return the present instant; never decreases."""
        self._now = max(self._now, self._clock())
        return self._now
