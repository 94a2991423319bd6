"""The battery itself: a link that breaks one rule fails the check of that rule."""

import asyncio
import inspect
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from tests.conformance.harnesses import SimHarness, scenario
from tests.links.evologics.driver.harness import EvologicsHarness
from tests.runtime.loop_checks import run
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Service,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.link import Link, LinkReceiver
from zacoustic.testing import conformance
from zacoustic.testing.conformance import CHECKS, Check
from zacoustic.testing.linkpair import Side
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.link import EvologicsLink
from zacoustic_sim.link import SimConfig, SimLink
from zacoustic_sim.medium import LocalConnection, SimMedium
from zacoustic_sim.messages import Answered, Heard


class Mutant(SimLink):
    """A simulated modem with one fault."""

    real: LinkReceiver

    async def open(self, receiver: LinkReceiver) -> None:
        self.real = receiver
        await super().open(receiver)


class CallsBackFromTransmit(Mutant):
    def transmit(self, transmission: Transmission) -> None:
        super().transmit(transmission)
        self.real.carrier_changed(True)


class ReportsTwice(Mutant):
    def _pass_on(self, report: TransmitReport | None) -> None:
        super()._pass_on(report)
        super()._pass_on(report)


class NeverReportsWhatIsTooLarge(Mutant):
    def _refuse(self, transmission_id: int, outcome: TransmitOutcome, reason: str) -> None:
        pass


class CallsBackAfterClose(Mutant):
    async def close(self) -> None:
        await super().close()
        asyncio.get_running_loop().call_soon(self.real.carrier_changed, False)


class ForgetsWhatIsOnTheAir(Mutant):
    async def close(self) -> None:
        self._pending.clear()
        await super().close()


class ChangesTheFrame(Mutant):
    def _hear(self, message: Heard, at: int) -> None:
        super()._hear(msgspec.structs.replace(message, frame_bytes=message.frame_bytes[:-1]), at)


class StampsTheFuture(Mutant):
    def _hear(self, message: Heard, at: int) -> None:
        super()._hear(message, at + 10**9)


class LiesAboutTheSender(Mutant):
    def _hear(self, message: Heard, at: int) -> None:
        super()._hear(msgspec.structs.replace(message, source=77), at)


class LiesAboutItsRate(Mutant):
    def _welcome(self, message: Any) -> None:
        told = msgspec.structs.replace(message.capabilities, bit_rate_bps=1.0)
        super()._welcome(msgspec.structs.replace(message, capabilities=told))


class MeasuresNothing(Mutant):
    def _hear(self, message: Heard, at: int) -> None:
        super()._hear(msgspec.structs.replace(message, metrics=type(message.metrics)()), at)


class TellsAnOldDelay(Mutant):
    def _measure(self, message: Answered, at: int) -> None:
        super()._measure(message, at - 10**9)


class TellsNoDelay(Mutant):
    def _measure(self, message: Answered, at: int) -> None:
        pass


class HasNoCarrier(Mutant):
    def _sense(self, busy: bool) -> None:
        pass


class TakesFramesWhenClosed(Mutant):
    def transmit(self, transmission: Transmission) -> None:
        if self._receiver is not None:
            super().transmit(transmission)


class MutantHarness(SimHarness):
    def __init__(self, mutant: type[Mutant], profile: str) -> None:
        super().__init__(profile, 50.0, SimConfig())
        self._mutant = mutant

    async def set_up(self) -> tuple[Link, Link]:
        self.medium = medium = SimMedium(self._scenario, time_scale=50.0)
        near, far = (
            self._mutant(
                LocalConnection(medium, address),
                SimConfig(acknowledges=True),
                node_address=address,
            )
            for address in self.addresses
        )
        return near, far


PROFILE = "evologics_s2c_18_34"

MUTANTS: list[tuple[type[Mutant], Check]] = [
    (CallsBackFromTransmit, conformance.carries_frames_both_ways),
    (ReportsTwice, conformance.reports_each_transmission_once),
    (NeverReportsWhatIsTooLarge, conformance.rejects_what_it_cannot_send),
    (CallsBackAfterClose, conformance.is_silent_after_close),
    (ForgetsWhatIsOnTheAir, conformance.aborts_what_is_on_the_air_when_closed),
    (ChangesTheFrame, conformance.carries_a_frame_of_mtu_bytes),
    (StampsTheFuture, conformance.carries_frames_both_ways),
    (LiesAboutTheSender, conformance.carries_frames_both_ways),
    (LiesAboutItsRate, conformance.lasts_as_long_as_it_says),
    (MeasuresNothing, conformance.measures_what_it_says),
    (TellsAnOldDelay, conformance.measures_ranges),
    (TellsNoDelay, conformance.measures_ranges),
    (HasNoCarrier, conformance.senses_the_carrier),
    (TakesFramesWhenClosed, conformance.closes_twice_and_unopened),
]


@pytest.mark.parametrize(("mutant", "check"), MUTANTS, ids=[each.__name__ for each, _ in MUTANTS])
def test_battery_finds_the_fault(
    mutant: type[Mutant], check: Check, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A check that waits for what never comes fails when its patience ends.
    monkeypatch.setattr("zacoustic.testing.linkpair.PATIENCE_S", 0.3)
    with pytest.raises(AssertionError):
        run(check(MutantHarness(mutant, PROFILE)))


class BulkMutant(EvologicsLink):
    """A driver whose bulk service has one fault: in what it says of itself, or what it reports."""

    async def open(self, receiver: LinkReceiver) -> None:
        await super().open(Twisted(receiver, self))

    def said(self, capabilities: LinkCapabilities) -> LinkCapabilities:
        return capabilities

    def heard(self, frame: ReceivedFrame) -> ReceivedFrame:
        return frame

    def reported(self, report: TransmitReport) -> list[TransmitReport]:
        return [report]


class Twisted:
    """Passes on what a link reports, as a mutant has it."""

    def __init__(self, receiver: LinkReceiver, mutant: BulkMutant) -> None:
        self._receiver = receiver
        self._mutant = mutant

    def __getattr__(self, name: str) -> Any:
        return getattr(self._receiver, name)

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        self._mutant.capabilities = self._mutant.said(self._mutant.capabilities)
        self._receiver.state_changed(state, detail)

    def frame_received(self, frame: ReceivedFrame) -> None:
        self._receiver.frame_received(self._mutant.heard(frame))

    def transmit_finished(self, report: TransmitReport) -> None:
        for each in self._mutant.reported(report):
            self._receiver.transmit_finished(each)


class TellsNoService(BulkMutant):
    def heard(self, frame: ReceivedFrame) -> ReceivedFrame:
        return msgspec.structs.replace(frame, service=Service.PLAIN)


class SaysItTakesMore(BulkMutant):
    def said(self, capabilities: LinkCapabilities) -> LinkCapabilities:
        assert capabilities.bulk is not None
        more = msgspec.structs.replace(capabilities.bulk, most_outstanding=40)
        return msgspec.structs.replace(capabilities, bulk=more)


class ReportsABulkFrameTwice(BulkMutant):
    def reported(self, report: TransmitReport) -> list[TransmitReport]:
        return [report, report] if report.outcome is TransmitOutcome.DELIVERED else [report]


class ForgetsWhatIsAborted(BulkMutant):
    def reported(self, report: TransmitReport) -> list[TransmitReport]:
        return [] if report.outcome is TransmitOutcome.ABORTED else [report]


class RejectsWithoutAReason(BulkMutant):
    def reported(self, report: TransmitReport) -> list[TransmitReport]:
        return [msgspec.structs.replace(report, detail="")]


class LosesPlainFrames(BulkMutant):
    def transmit(self, transmission: Transmission) -> None:
        if transmission.service is Service.BULK:
            super().transmit(transmission)


class BulkMutantHarness(EvologicsHarness):
    def __init__(self, mutant: type[BulkMutant]) -> None:
        super().__init__(EvologicsConfig(bulk=True))
        self.link_type = mutant


BULK_MUTANTS: list[tuple[type[BulkMutant], Check]] = [
    (TellsNoService, conformance.carries_bulk_frames_both_ways),
    (SaysItTakesMore, conformance.takes_as_many_bulk_frames_as_it_says),
    (ReportsABulkFrameTwice, conformance.takes_as_many_bulk_frames_as_it_says),
    (LosesPlainFrames, conformance.carries_a_plain_frame_beside_bulk),
    (RejectsWithoutAReason, conformance.rejects_bulk_frames_that_it_cannot_send),
    (ForgetsWhatIsAborted, conformance.aborts_bulk_frames_when_closed),
    (ForgetsWhatIsAborted, conformance.reports_bulk_frames_that_a_cut_interrupts),
]


@pytest.mark.parametrize(
    ("mutant", "check"),
    BULK_MUTANTS,
    ids=[f"{each.__name__}-{check.__name__}" for each, check in BULK_MUTANTS],
)
def test_battery_finds_the_fault_of_a_bulk_service(
    mutant: type[BulkMutant], check: Check, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Side, "limit_s", 4.0)
    with pytest.raises(AssertionError):
        run(check(BulkMutantHarness(mutant)))


def test_mutation_without_a_fault_passes_everything() -> None:
    for check in CHECKS:
        run(check(MutantHarness(Mutant, PROFILE)))


def test_every_check_is_in_the_list() -> None:
    public: list[Callable[..., Any]] = [
        value
        for name, value in vars(conformance).items()
        if inspect.iscoroutinefunction(value) and value.__module__ == conformance.__name__
        and not name.startswith("_")
    ]  # fmt: skip
    assert set(public) == set(CHECKS)
    assert scenario(PROFILE).loss.frame == 0.0
