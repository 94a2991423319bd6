"""Burst data: a queue, a connection that is set up for it, and trains of packets.

No source describes the signals of a burst, so this follows what is known. Service signals request
and grant a connection, the granting modem proposes a bit rate, then packets go in trains, each
acknowledged as a whole and repeated up to `AT!RC` times. A repeated packet is delivered once. The
connection closes when nothing is left to send, so that `AT?S` shows again that the modem listens.
If a connection fails, all data queued for it fail, and the modem enters its backoff state for a
while.
"""

from collections.abc import Callable, Iterable

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import BROADCAST
from zacoustic_evologics.airtime import BURST_RATES_BPS, burst_airtime_ns, service_airtime_ns
from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at import refusals
from zacoustic_evologics.at.commands import SendBurst
from zacoustic_evologics.at.fields import BURST_LIMIT_BYTES
from zacoustic_evologics.at.messages import RawData
from zacoustic_evologics.at.replies import Accepted, Refused
from zacoustic_evologics.emulator.exchanges.exchange import Ending, Exchange
from zacoustic_evologics.emulator.exchanges.instant import InstantMessages, check_message
from zacoustic_evologics.emulator.exchanges.pool import Queued, TransmitPool
from zacoustic_evologics.emulator.hardware.chassis import Chassis, Origin
from zacoustic_evologics.emulator.hardware.signals import BurstPacket, Hearing, Signal, SignalKind
from zacoustic_evologics.emulator.hardware.transducer import Transducer


class Bursts:
    """The burst service of one modem.

    Args:
        chassis: Chassis of the modem.
        transducer: Transducer of the modem.
        instant: Its messages, which go with service signals.
    """

    def __init__(self, chassis: Chassis, transducer: Transducer, instant: InstantMessages) -> None:
        self.pool = TransmitPool(lambda: chassis.store["ZL"])
        self._chassis = chassis
        self._transducer = transducer
        self._instant = instant
        self._exchange: Exchange | None = None
        self._train: tuple[Queued, ...] = ()
        self._peer: int | None = None
        self._wanted: int | None = None
        self._held_until: int | None = None
        self._last_trains: dict[int, int] = {}

    @property
    def state(self) -> str:
        """Words for `AT?S`; empty if there is no connection and none is requested."""
        if self._peer is not None:
            return "ONLINE"
        return "INITIATION ESTABLISH" if self._exchange is not None else ""

    def send(self, origin: Origin, command: SendBurst, now: int) -> Accepted | Refused:
        """`AT*SEND`."""
        refused = check_message(self._chassis, self._transducer, command)
        if refused == refusals.WRONG_DESTINATION and command.destination == BROADCAST:
            # No source knows the answer; DESERT's driver hangs on WRONG DESTINATION ADDRESS.
            refused = refusals.WRONG_FORMAT
        if refused is None and now < self._transducer.backoff_until:
            refused = refusals.BACKOFF
        if refused is not None:
            return refused
        pid = origin.pid if command.pid is None else command.pid
        packet = BurstPacket(command.payload, pid, is_raw=False)
        if not self.pool.put(packet, command.destination, origin.port_id):
            return refusals.BUFFER_FULL
        self.look(now)
        return Accepted()

    def send_raw(self, origin: Origin, content: bytes, now: int) -> None:
        """Take raw data of a port in data mode, for the remote address."""
        remote = self._chassis.store["AR"]
        for start in range(0, len(content), BURST_LIMIT_BYTES):
            piece = content[start : start + BURST_LIMIT_BYTES]
            packet = BurstPacket(piece, origin.pid, is_raw=True)
            is_sendable = remote not in (0, self._chassis.address) and self._transducer.is_on
            if not is_sendable or not self.pool.put(packet, remote, origin.port_id):
                dropped = len(content) - start
                self._chassis.measured.dropped_bytes += dropped
                self._chassis.say(said.DropCount(dropped))
                break
        self.look(now)

    def connect(self, destination: int, now: int) -> None:
        """`ATD`: make a connection; it closes again if there is nothing to send."""
        self._wanted = destination
        self.look(now)

    def proposed_bps(self, snr_db: float) -> int:
        """Return the bit rate for a modem received with this SNR."""
        rates_bps = self._chassis.behaviour.burst_rates_bps
        return next(rate for least_db, rate in rates_bps if snr_db >= least_db)

    def look(self, now: int) -> None:
        """Advance if an awaited event has happened."""
        if self._exchange is not None:
            self._exchange.look(now)
            return
        if now < self._transducer.backoff_until:
            return
        target = self.pool.next_destination or self._wanted
        if self._must_wait(now):
            return
        if target is None:
            self._close()
        elif target != self._peer:
            self._ask(target, now)
        elif self.pool:
            self._send_train(target, now)
        else:
            self._wanted = None
            self._close()

    @property
    def is_sending(self) -> bool:
        """Whether it sends, or has data to send."""
        return self._exchange is not None or bool(self.pool)

    def _must_wait(self, now: int) -> bool:
        """Return whether a connection without data stays, and see to its end."""
        hold_ns = seconds_to_ns(self._chassis.behaviour.hold_s)
        if self._peer is None or self.pool or self._wanted is not None or not hold_ns:
            self._held_until = None
            return False
        if self._held_until is None:
            self._held_until = now + hold_ns
            self._chassis.agenda.push(self._held_until, self.look, self._held_until)
        return now < self._held_until

    def handle_sent(self, signal: Signal, now: int) -> None:
        """Note that a signal has left."""
        if self._exchange is not None:
            self._exchange.handle_sent(signal, now)

    def handle_answer(self, hearing: Hearing, now: int) -> bool:
        """Take an answer; return whether it was for this service."""
        exchange = self._exchange
        if exchange is None or exchange.signal.number != hearing.signal.number:
            return False
        if hearing.signal.bit_rate_bps:
            self._chassis.measured.local_bps = hearing.signal.bit_rate_bps
        return exchange.handle_answer(hearing, now)

    def handle_train(self, hearing: Hearing) -> None:
        """Deliver the packets of a train, unless they were delivered before."""
        signal = hearing.signal
        self._chassis.measured.remote_bps = signal.bit_rate_bps
        if self._last_trains.get(signal.source) == signal.number:
            return
        self._last_trains[signal.source] = signal.number
        for packet in signal.packets:
            if packet.is_raw:
                self._chassis.say(RawData(packet.payload))
                continue
            self._chassis.say(
                hearing.told(
                    said.Recv,
                    payload=packet.payload,
                    bit_rate_bps=signal.bit_rate_bps,
                    propagation_us=hearing.propagation_us,
                    pid=packet.pid,
                )
            )

    def drop(self) -> None:
        """`ATZ1`, `ATH`: drop the queue, whose data fail, and close the connection."""
        exchange, self._exchange = self._exchange, None
        if exchange is not None:
            exchange.cancel()
        self._wanted = None
        self._fail(self.pool.take_all())
        self._close()

    def restart(self) -> None:
        """Discard all state except the delivered packets."""
        self.pool = TransmitPool(lambda: self._chassis.store["ZL"])
        self._exchange = None
        self._peer = self._wanted = self._held_until = None

    def _ask(self, destination: int, now: int) -> None:
        self._close()
        piggyback = self._instant.take_piggyback(destination)
        piggyback_bytes = len(piggyback.payload) if piggyback else 0
        signal = Signal(
            kind=SignalKind.CONNECT,
            source=self._chassis.address,
            destination=destination,
            duration_ns=service_airtime_ns(piggyback_bytes),
            number=self._chassis.next_number(),
            piggyback=piggyback,
            level=self._chassis.store["L"],
        )
        self._start(signal, SignalKind.ACCEPT, self._asked, now)

    def _asked(self, ending: Ending, now: int) -> None:
        assert self._exchange is not None
        destination = self._exchange.signal.destination
        self._exchange = None
        if ending is Ending.ANSWERED:
            self._peer = destination
            self._chassis.say(said.RemoteAddress(destination))
            self._chassis.say(said.BitRate(said.Direction.LOCAL, self._chassis.measured.local_bps))
            self._chassis.say(said.Status("ONLINE", "CONNECTED"))
            self.look(now)
        else:
            self._lose(destination, now)

    def _send_train(self, destination: int, now: int) -> None:
        if self._chassis.behaviour.im_in_train == "taken":
            self._instant.look(now)  # a message goes between two trains
        rate_bps = self._chassis.measured.local_bps or BURST_RATES_BPS[-1]
        self._train = self.pool.train(
            self._chassis.store["ZC"], rate_bps, seconds_to_ns(self._chassis.behaviour.train_s)
        )
        packets = tuple(item.packet for item in self._train)
        signal = Signal(
            kind=SignalKind.TRAIN,
            source=self._chassis.address,
            destination=destination,
            duration_ns=burst_airtime_ns(sum(len(each.payload) for each in packets), rate_bps),
            number=self._chassis.next_number(),
            packets=packets,
            bit_rate_bps=rate_bps,
            level=self._chassis.store["L"],
        )
        self._start(signal, SignalKind.TRAIN_ACK, self._train_ended, now)

    def _train_ended(self, ending: Ending, now: int) -> None:
        assert self._exchange is not None
        destination = self._exchange.signal.destination
        self._exchange = None
        if ending is not Ending.ANSWERED:
            self._lose(destination, now)
            return
        self.pool.take(len(self._train))
        for item in self._train:
            if item.packet.is_raw:
                self._chassis.measured.delivered_raw_bytes += len(item.packet.payload)
            else:
                report = said.Delivered(counter=item.counter, destination=destination)
                self._chassis.say(report, item.port_id)
        self.look(now)

    def _start(
        self, signal: Signal, answer: SignalKind, ended: Callable[[Ending, int], None], now: int
    ) -> None:
        self._exchange = Exchange(
            self._chassis,
            self._transducer,
            signal,
            answer=answer,
            attempts=1 + self._chassis.store["RC"],
            ended=ended,
        )
        self._exchange.look(now)

    def _lose(self, destination: int, now: int) -> None:
        """Give a connection up, with all data queued for it."""
        lost = self.pool.take_all(destination)
        self._peer = self._wanted = None
        self._chassis.say(said.Status("OFFLINE", "CONNECTION_FAILED"))
        self._fail(lost)
        longest_ns = self._chassis.behaviour.backoff_share * self._chassis.store["RT"] * 1e6
        pause_ns = round(self._chassis.rng.random() * longest_ns)
        self._transducer.backoff_until = now + pause_ns
        self._chassis.say(said.Status("BACKOFF", "CONNECTION_FAILED"))
        over_at = self._transducer.backoff_until
        self._chassis.agenda.push(over_at, self._end_backoff, over_at)

    def _end_backoff(self, now: int) -> None:
        self._chassis.say(said.Status("INITIATION", "LISTEN"))
        self.look(now)

    def _fail(self, items: Iterable[Queued]) -> None:
        for item in items:
            if item.packet.is_raw:
                self._chassis.measured.dropped_bytes += len(item.packet.payload)
                self._chassis.say(said.DropCount(len(item.packet.payload)))
            else:
                report = said.Failed(counter=item.counter, destination=item.destination)
                self._chassis.say(report, item.port_id)

    def _close(self) -> None:
        self._held_until = None
        if self._peer is not None:
            self._peer = None
            self._chassis.say(said.Status("OFFLINE", "CLOSED"))
            self._chassis.say(said.Status("INITIATION", "LISTEN"))
