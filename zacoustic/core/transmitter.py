"""When a frame goes, and what is booked for it: the link, its access, silence and airtime caps."""

import random

from zacoustic.core.access import Wanted
from zacoustic.core.airtime import AirtimeCaps
from zacoustic.core.linktypes import LinkCapabilities, LinkState, Transmission, TransmitReport
from zacoustic.core.measurements import Measurements
from zacoustic.core.port import LinkPort
from zacoustic.core.protocols import Protocols
from zacoustic.core.queue import LaneKey
from zacoustic.core.rules import TransmitRules
from zacoustic.core.silence import Silence
from zacoustic.core.stats import EngineStats

_GIVE_WAY_PERIODS = 2
"""For so many runs and pauses ranges wait behind what presses: it goes again in a pause."""


class Transmitter:
    """Makes the transmissions of one engine.

    Args:
        address: Address of the node.
        protocols: What it has to say.
        silence: When it must not.
        rules: What the config says of transmitting.
        stats: Counts.
        rng: For the back-off of the medium access.
        measurements: What was measured of the others; only read.
    """

    def __init__(
        self,
        address: int,
        protocols: Protocols,
        silence: Silence,
        rules: TransmitRules,
        stats: EngineStats,
        rng: random.Random,
        measurements: Measurements,
    ) -> None:
        self.port: LinkPort | None = None
        """The link; None before it was up."""
        self.link_state = LinkState.OPENING
        """What the link last said of itself."""
        self.airtime = AirtimeCaps(rules.max_airtime)
        """How much of the time streams and node may be on the air."""
        self._address = address
        self._protocols = protocols
        self._silence = silence
        self._rules = rules
        self._stats = stats
        self._rng = rng
        self._measurements = measurements
        self._clock: tuple[int, int] | None = None
        self._next_transmission_id = 1

    def use_link(self, capabilities: LinkCapabilities, now: int) -> None:
        """Begin with a link, or with other capabilities of it."""
        port = LinkPort(
            capabilities,
            self._address,
            self._rng,
            self._rules.access,
            envelope=self._protocols.envelope(capabilities),
            measurements=self._measurements,
        )
        self.port = port
        if self._clock is not None:
            port.access.handle_clock(*self._clock, now)
        self._protocols.use_link(port, now)

    def handle_clock(self, offset_ns: int, error_ns: int, now: int) -> None:
        """The host tells what its clock says; see `Engine.handle_clock`."""
        self._clock = (offset_ns, error_ns)
        if self.port is not None:
            self.port.access.handle_clock(offset_ns, error_ns, now)

    def make(self, now: int) -> tuple[Transmission, tuple[int, ...]] | None:
        """Make the transmission that is worth most now, if one may begin.

        Returns:
            It, and the streams of its records.
        """
        port = self.port
        if port is None:
            return None
        protocols = self._protocols
        composed = None
        granted = self._silence.granted(now)
        if granted is not None:
            if _is_over(self._last_word_at(granted, now), now):
                composed = protocols.compose_only(port, granted, now)
                self._silence.use_grant()
        elif _is_over(self._transmit_at(now), now):
            composed = protocols.compose(port, now)
        if composed is None and _is_over(self._speak_at(now), now):
            composed = protocols.speak(port, now)
        if composed is None:
            return None
        transmission = Transmission(
            transmission_id=self._next_transmission_id,
            frame_bytes=composed.frame_bytes,
            destination=composed.destination,
            acknowledge=self._protocols.ranging.wants(
                composed.destination, now, gives_way=composed.is_pressing
            ),
        )
        self._next_transmission_id += 1
        if composed.is_pressing:
            until = now + _GIVE_WAY_PERIODS * port.listening.period_ns
            protocols.ranging.give_way(composed.destination, until)
        port.transmit(transmission, now)
        self._protocols.transmitted(transmission, composed, now)
        self._stats.frames_transmitted += 1
        self._stats.bytes_transmitted += len(composed.frame_bytes)
        airtime_ns = port.capabilities.airtime_ns(len(composed.frame_bytes))
        self._stats.airtime_ns += airtime_ns
        held = self.airtime.spend(composed.stream_bytes, airtime_ns, now)
        for stream_id, until in held.items():
            self._protocols.queue.hold(stream_id, until)
            self._protocols.large.objects.hold(stream_id, until)
        return transmission, composed.streams

    def finish(self, report: TransmitReport, now: int) -> bool:
        """Note the end of a transmission; False for a report that belongs to none."""
        return self.port is not None and self.port.finish(report, now)

    def next_at(self, now: int) -> int | None:
        """Return the instant from which a frame can and should go, ns, or None."""
        granted = self._silence.granted(now)
        if granted is not None:
            return self._last_word_at(granted, now)
        instants = (self._transmit_at(now), self._speak_at(now))
        return min((at for at in instants if at is not None), default=None)

    # Below the methods above

    def _transmit_at(self, now: int) -> int | None:
        """Return when a frame of what waits goes."""
        if self.link_state is not LinkState.UP or self.port is None:
            return None
        if not self._protocols.may_speak:
            return None
        due_at = self._protocols.due_at(now)
        if due_at is None:
            return None
        self.port.listening.exclusive = self._protocols.large.objects.is_exclusive
        self.port.listening.sends_full = self._protocols.large.objects.has_fragment(now)
        is_urgent = self._protocols.queue.is_urgent
        if not is_urgent:
            even_at = self.airtime.free_at(now)
            due_at = max(due_at, even_at) if even_at > now else due_at
        wanted = Wanted(due_at, is_urgent, is_copy=self._protocols.queue.has_copy)
        return self._after_silence(self.port.free_at(wanted, now), now)

    def _last_word_at(self, lane: LaneKey, now: int) -> int | None:
        """Return when the frame goes that a silence grants to a lane."""
        if self.link_state is not LinkState.UP or self.port is None:
            return None
        due_at = self._protocols.queue.due_at(now, lane)
        return None if due_at is None else self.port.free_at(Wanted(due_at, is_urgent=True), now)

    def _speak_at(self, now: int) -> int | None:
        """Return when medium access wants a frame of its own."""
        if self.link_state is not LinkState.UP or self.port is None:
            return None
        return self._after_silence(self.port.speak_at(now), now)

    def _after_silence(self, instant: int | None, now: int) -> int | None:
        silent_until = self._silence.until(now)
        if instant is None or silent_until is None:
            return None
        return max(instant, silent_until) if silent_until > now else instant


def _is_over(instant: int | None, now: int) -> bool:
    return instant is not None and instant <= now
