"""The simulated modem: the link contract over a medium in this process or, by TCP, in another.

The modem has the features of its profile. Settings remove some of them, to test what the core does
for poorer modems: addresses, check, frame boundaries, carrier sense. The effects are real: an
unaddressed modem receives frames for others, an unchecked one delivers damaged frames, an unframed
one delivers pieces.
"""

import asyncio
import random
import time
from typing import Annotated, Final, Self

import msgspec
from msgspec import Meta

from zacoustic.core.clock import Clock
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkState,
    PeerMeasured,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.errors import ConfigError, LinkClosedError, LinkOpenError
from zacoustic.link import Link, LinkConfig, LinkReceiver
from zacoustic_sim.connection import Connection, StreamConnection
from zacoustic_sim.messages import (
    Answered,
    Carrier,
    Finished,
    Heard,
    Refused,
    ServerMessage,
    Transmit,
    Welcome,
)

WAIT_S: Final = 10.0
"""Time for which `open` waits for the medium, s: gateways and medium often start together."""


class SimConfig(LinkConfig, frozen=True, kw_only=True):
    """Settings of the simulated modem."""

    addressed: bool = True
    """Frames carry addresses."""
    checked: bool = True
    """Damaged frames are dropped."""
    framed: bool = True
    """Frames arrive as frames, not as pieces of a byte stream."""
    senses_carrier: bool = True
    """The modem reports when another node is audible."""
    acknowledges: bool = False
    """The modem acknowledges frames on request, and measures the range by the answer."""
    wait_s: Annotated[float, Meta(gt=0, title="seconds")] = WAIT_S
    """Time for which `open` waits for the medium, s."""


class SimLink(Link):
    """A modem on a simulated channel; the locator is sim/HOST:PORT of a medium server.

    Args:
        connection: Connection to the medium.
        config: Features to remove.
        node_address: Acoustic address, one of the scenario's nodes.
        clock: Source of instants.
    """

    config_type = SimConfig

    def __init__(
        self,
        connection: Connection,
        config: SimConfig | None = None,
        *,
        node_address: int,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        self._connection = connection
        self._config = config or SimConfig()
        self._address = node_address
        self._clock = clock
        self._receiver: LinkReceiver | None = None
        self._state = LinkState.OPENING
        self._detail = ""
        self._welcomed: asyncio.Future[None] | None = None
        # Transmissions without a report: transmission id → instant of the call.
        self._pending: dict[int, int] = {}
        self._on_air: int | None = None
        self._carrier = False
        self._last_at = 0
        self._split = random.Random(node_address)
        self._counts = dict.fromkeys(("sent", "received", "for_others", "damaged", "refused"), 0)

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        """Build the modem `node_address` of the medium server at `HOST:PORT`.

        Raises:
            ConfigError: The address is not valid, or the node address is outside 1…254.
        """
        assert isinstance(config, SimConfig)
        if not 1 <= node_address <= 254:
            raise ConfigError(f"node address is {node_address}; allowed: 1..254")
        if address.startswith(("tcp:", "serial:")):
            raise ConfigError(f"sim/{address}; allowed: sim/HOST:PORT, of `zacoustic run medium`")
        connection = StreamConnection(address, node_address=node_address)
        return cls(connection, config, node_address=node_address)

    async def open(self, receiver: LinkReceiver) -> None:
        """Take the node's place on the channel; wait up to `wait_s` for the medium.

        Raises:
            LinkOpenError: The medium does not answer in time, or refuses the address.
        """
        if self._receiver is not None:
            raise LinkOpenError(f"node {self._address} is open already")
        self._receiver = receiver
        self._state, self._detail = LinkState.OPENING, ""
        self._on_air = None
        self._carrier = False
        self._welcomed = asyncio.get_running_loop().create_future()
        self._change_state(
            LinkState.OPENING, f"waiting for the medium at {self._connection.address}"
        )
        self._connection.open(self)
        try:
            async with asyncio.timeout(self._config.wait_s):
                await self._welcomed
        except TimeoutError as error:
            await self.close()
            raise LinkOpenError(
                f"no medium at {self._connection.address} within {self._config.wait_s:g} s: "
                f"{self._detail}",
                hint=self._connection.hint,
            ) from error
        except BaseException:
            await self.close()
            raise
        finally:
            self._welcomed = None

    async def close(self) -> None:
        """Leave the channel; before that report an outstanding frame as ABORTED."""
        # First without a receiver: a report may cause another `transmit`, which must fail.
        receiver, self._receiver = self._receiver, None
        for transmission_id in tuple(self._pending):
            aborted = self._settle(transmission_id, TransmitOutcome.ABORTED, detail="link closed")
            if receiver is not None and aborted is not None:
                receiver.transmit_finished(aborted)
        await self._connection.close()

    def transmit(self, transmission: Transmission) -> None:
        """Transmit a frame.

        Raises:
            LinkClosedError: Not open.
        """
        if self._receiver is None:
            raise LinkClosedError(f"node {self._address} is not open")
        transmission_id = transmission.transmission_id
        self._pending[transmission_id] = self._clock()
        if self._state is not LinkState.UP:
            self._refuse(transmission_id, TransmitOutcome.ABORTED, f"no medium: {self._detail}")
        elif reason := self._objection(transmission):
            self._refuse(transmission_id, TransmitOutcome.REJECTED, reason)
        else:
            to = transmission.destination if self._config.addressed else BROADCAST
            asks = transmission.acknowledge and self.capabilities.acknowledges and to != BROADCAST
            frame_bytes = transmission.frame_bytes
            if self._connection.send(Transmit(transmission_id, to, frame_bytes, asks)):
                self._on_air = transmission_id
            else:
                self._refuse(transmission_id, TransmitOutcome.ABORTED, "no connection")

    def diagnostics(self) -> dict[str, int | float | str]:
        """Return outcomes of frames, the state, and what the link waits for."""
        return {**self._counts, "state": self._state.value, "detail": self._detail}

    def message_received(self, message: ServerMessage, received_at: int) -> None:
        """Take a message of the medium; called by the connection."""
        match message:
            case Heard():
                self._hear(message, received_at - message.ago_ns)
            case Finished():
                self._finish(message, received_at - message.ago_ns)
            case Answered():
                self._measure(message, received_at - message.ago_ns)
            case Carrier():
                self._sense(message.busy)
            case Welcome():
                self._welcome(message)
            case Refused():
                self._be_refused(message.reason)

    def connection_lost(self, reason: str) -> None:
        """Note that the medium was lost or not reached; called by the connection."""
        if self._state is LinkState.UP:
            self._sense(False)
            self._change_state(LinkState.DOWN, reason)
            if self._on_air is not None:
                aborted = TransmitOutcome.ABORTED
                self._pass_on(self._settle(self._on_air, aborted, detail=reason))
        elif not self._detail.startswith("refused"):  # the refusal tells more than the loss
            self._change_state(self._state, reason)

    def _welcome(self, message: Welcome) -> None:
        config, told = self._config, message.capabilities
        acknowledges = told.acknowledges and config.acknowledges and config.addressed
        self.capabilities = msgspec.structs.replace(
            told,
            addressed=told.addressed and config.addressed,
            checked=told.checked and config.checked,
            framed=told.framed and config.framed,
            senses_carrier=told.senses_carrier and config.senses_carrier,
            acknowledges=acknowledges,
            measures=told.measures if acknowledges else frozenset(),
            measures_range=acknowledges,
        )
        self._change_state(LinkState.UP, f"{message.profile} at {self._connection.address}")
        if self._welcomed is not None and not self._welcomed.done():
            self._welcomed.set_result(None)

    def _be_refused(self, reason: str) -> None:
        self._change_state(self._state, f"refused: {reason}")
        if self._welcomed is not None and not self._welcomed.done():
            self._welcomed.set_exception(
                LinkOpenError(f"the medium at {self._connection.address} refuses: {reason}")
            )

    def _change_state(self, state: LinkState, detail: str) -> None:
        if (state, detail) == (self._state, self._detail):
            return
        self._state, self._detail = state, detail
        if self._receiver is not None:
            self._receiver.state_changed(state, detail)

    def _hear(self, message: Heard, at: int) -> None:
        if self._config.addressed and message.destination not in (BROADCAST, self._address):
            self._counts["for_others"] += 1
            return
        if message.damaged:
            self._counts["damaged"] += 1
            if self._config.checked:
                return
        self._counts["received"] += 1
        self._last_at = max(self._last_at, at)
        frame = ReceivedFrame(
            frame_bytes=message.frame_bytes,
            received_at=self._last_at,
            source=message.source if self._config.addressed else 0,
            destination=message.destination if self._config.addressed else BROADCAST,
            metrics=message.metrics,
        )
        for piece in (frame,) if self._config.framed else self._pieces(frame):
            if self._receiver is not None:
                self._receiver.frame_received(piece)

    def _pieces(self, frame: ReceivedFrame) -> tuple[ReceivedFrame, ...]:
        """Cut a frame in two somewhere, as a byte stream may."""
        whole = frame.frame_bytes
        cut = self._split.randrange(len(whole))
        return tuple(
            msgspec.structs.replace(frame, frame_bytes=part)
            for part in (whole[:cut], whole[cut:])
            if part
        )

    def _finish(self, message: Finished, at: int) -> None:
        if message.outcome is not TransmitOutcome.REJECTED:
            self._counts["sent"] += 1
        self._pass_on(
            self._settle(
                message.transmission_id,
                message.outcome,
                finished_at=at,
                lasted_ns=message.lasted_ns,
                detail=message.detail,
            )
        )

    def _measure(self, message: Answered, at: int) -> None:
        """Pass on the measurements of an acknowledgement."""
        if self._receiver is not None:
            self._receiver.measured(
                PeerMeasured(address=message.source, measured_at=at, metrics=message.metrics)
            )

    def _sense(self, busy: bool) -> None:
        if busy == self._carrier:
            return
        self._carrier = busy
        if self._config.senses_carrier and self._receiver is not None:
            self._receiver.carrier_changed(busy)

    def _objection(self, transmission: Transmission) -> str:
        """Return why a working modem would refuse this transmission; empty: it would not."""
        size, limit = len(transmission.frame_bytes), self.capabilities.mtu_bytes
        if not 1 <= size <= limit:
            return f"frame of {size} bytes; allowed: 1..{limit}"
        if not 1 <= transmission.destination <= BROADCAST:
            return f"destination {transmission.destination}; allowed: 1..{BROADCAST}"
        if self._on_air is not None:
            return f"transmission {self._on_air} is outstanding"
        return ""

    def _refuse(self, transmission_id: int, outcome: TransmitOutcome, reason: str) -> None:
        """Report soon, but not from within `transmit`."""
        self._counts["refused"] += 1
        loop = asyncio.get_running_loop()
        loop.call_soon(lambda: self._pass_on(self._settle(transmission_id, outcome, detail=reason)))

    def _pass_on(self, report: TransmitReport | None) -> None:
        if report is not None and self._receiver is not None:
            self._receiver.transmit_finished(report)

    def _settle(
        self,
        transmission_id: int,
        outcome: TransmitOutcome,
        *,
        finished_at: int | None = None,
        lasted_ns: int = 0,
        detail: str = "",
    ) -> TransmitReport | None:
        """Remove a transmission; return its report, or None if it was reported already."""
        called_at = self._pending.pop(transmission_id, None)
        if called_at is None:
            return None
        if transmission_id == self._on_air:
            self._on_air = None
        finished_at = max(called_at, self._clock() if finished_at is None else finished_at)
        return TransmitReport(
            transmission_id=transmission_id,
            outcome=outcome,
            started_at=max(called_at, finished_at - lasted_ns) if lasted_ns else called_at,
            finished_at=finished_at,
            detail=detail,
        )
