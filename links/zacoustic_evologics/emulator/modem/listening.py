"""What a modem does with a received signal: report it, answer it, or only note it."""

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import BROADCAST
from zacoustic_evologics.airtime import TURNAROUND_NS, service_airtime_ns
from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at.firmware import IM_BIT_RATE_BPS, tells_delays
from zacoustic_evologics.emulator.exchanges.bursts import Bursts
from zacoustic_evologics.emulator.exchanges.instant import InstantMessages
from zacoustic_evologics.emulator.exchanges.usblhead import UsblHead
from zacoustic_evologics.emulator.hardware.chassis import Chassis
from zacoustic_evologics.emulator.hardware.signals import Hearing, Signal, SignalKind
from zacoustic_evologics.emulator.hardware.transducer import Transducer
from zacoustic_evologics.emulator.modem.levelcontrol import LevelControl

_ANSWERS = {
    SignalKind.IM: SignalKind.ACK,
    SignalKind.CONNECT: SignalKind.ACCEPT,
    SignalKind.TRAIN: SignalKind.TRAIN_ACK,
}
_SERVICES = frozenset({SignalKind.ACK, SignalKind.CONNECT, SignalKind.ACCEPT, SignalKind.TRAIN_ACK})


class Listener:
    """Handles the received signals of one modem.

    Args:
        chassis: Chassis of the modem.
        transducer: Transducer of the modem.
        instant: Its messages.
        bursts: Its connections.
        head: Its USBL head.
        level: Its level control.
    """

    def __init__(
        self,
        chassis: Chassis,
        transducer: Transducer,
        instant: InstantMessages,
        bursts: Bursts,
        head: UsblHead,
        level: LevelControl,
    ) -> None:
        self._chassis = chassis
        self._transducer = transducer
        self._instant = instant
        self._bursts = bursts
        self._head = head
        self._level = level

    def handle(self, hearing: Hearing, now: int) -> None:
        """Take a received signal."""
        signal = hearing.signal
        is_mine = signal.destination in (self._chassis.address, BROADCAST)
        is_reported = is_mine or self._chassis.store["RP"] == 1
        # An acknowledgement frees its slot before anything may fill it again.
        if signal.kind in _SERVICES:
            self._handle_service(hearing, now)
        elif signal.kind is SignalKind.TRAIN:
            if is_mine:
                self._bursts.handle_train(hearing)
        elif is_reported:
            self._report(hearing)
        if not is_reported:
            kind = signal.kind.value
            self._chassis.say(hearing.told(said.RecvSrv, kind=kind, decoded=1, transmitted=1))
        if is_reported and signal.piggyback is not None:
            self._chassis.say(self._piggyback_record(hearing))
        is_asking = signal.kind is not SignalKind.IM or signal.flag is said.ImFlag.ACK
        if is_mine and signal.kind in _ANSWERS and is_asking:
            self._owe_answer(hearing)

    def _handle_service(self, hearing: Hearing, now: int) -> None:
        if hearing.signal.destination != self._chassis.address:
            return
        if self._instant.handle_answer(hearing, now) or self._bursts.handle_answer(hearing, now):
            self._level.handle_answer(hearing)
            self._head.measure_position(hearing)

    def _report(self, hearing: Hearing) -> None:
        record = self._record(hearing)
        for after_s in hearing.reception.delays_s:
            if after_s:
                at = hearing.ends_at + seconds_to_ns(after_s)
                self._chassis.agenda.push(at, self._chassis.say, record)
            else:
                self._chassis.say(record)
        self._head.measure_angles(hearing)

    def _record(self, hearing: Hearing) -> said.Notification:
        signal = hearing.signal
        started_us = self._chassis.clock_us(hearing.starts_at)
        payload = hearing.reception.damage(signal.payload)
        if signal.kind is SignalKind.PROBE:
            duration_us = hearing.duration_ns // 1000
            return hearing.told(
                said.RecvProbe, bit=signal.bit, timestamp_us=started_us, duration_us=duration_us
            )
        if signal.kind is SignalKind.IMS:
            return hearing.told(
                said.RecvIms,
                payload=payload,
                timestamp_us=started_us,
                duration_us=signal.duration_ns // 1000,
                pid=signal.pid,
            )
        timing = self._timing(signal)
        return hearing.told(
            said.RecvIm, payload=payload, flag=signal.flag, pid=signal.pid, **timing
        )

    def _piggyback_record(self, hearing: Hearing) -> said.RecvPbm:
        carried = hearing.signal.piggyback
        assert carried is not None
        timing = self._timing(hearing.signal)
        return hearing.told(said.RecvPbm, payload=carried.payload, pid=carried.pid, **timing)

    def _timing(self, signal: Signal) -> dict[str, int]:
        """Return a firmware's timing fields: a delay is that of the last exchange, 0 for none."""
        if tells_delays(self._chassis.behaviour.firmware):
            delay_us = self._chassis.measured.propagation_us
            return {"bit_rate_bps": IM_BIT_RATE_BPS, "propagation_us": delay_us}
        return {"duration_us": signal.duration_ns // 1000}

    def _owe_answer(self, hearing: Hearing) -> None:
        self._transducer.owed += 1
        answered_at = hearing.ends_at + TURNAROUND_NS
        self._chassis.agenda.push(answered_at, self._answer, hearing, answered_at)

    def _answer(self, hearing: Hearing, at: int) -> None:
        self._transducer.owed -= 1
        asked = hearing.signal
        if self._transducer.is_transmitting(at) or not self._transducer.is_on:
            return
        piggyback = self._instant.take_piggyback(asked.source)
        self._transducer.transmit(
            Signal(
                kind=_ANSWERS[asked.kind],
                source=asked.destination,
                destination=asked.source,
                duration_ns=service_airtime_ns(len(piggyback.payload) if piggyback else 0),
                number=asked.number,
                piggyback=piggyback,
                bit_rate_bps=self._bursts.proposed_bps(hearing.snr_db),
                level=self._chassis.store["L"],
            ),
            at,
        )
