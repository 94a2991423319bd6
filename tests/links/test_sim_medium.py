import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from tests.runtime.loop_checks import run
from zacoustic.channel.faults.faults import FaultSpec
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.medium import Emission, Outcome, Reception
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import TransmitOutcome
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.testing.linkpair import Side
from zacoustic_sim.link import SimConfig
from zacoustic_sim.medium import Attached, Detached, Observation, SimMedium

SCALE = 50.0


def channel(*positions_m: float, **more: Any) -> Scenario:
    nodes = tuple(
        NodeSpec(address=at, position=(x, 0.0, 10.0)) for at, x in enumerate(positions_m, start=1)
    )
    return Scenario(**{"nodes": nodes, "channel": "none", **more})


def case(
    scenario: Scenario,
    body: Callable[[SimMedium, list[Side], list[tuple[int, Observation]]], Awaitable[None]],
    *,
    config: SimConfig | None = None,
    scale: float = SCALE,
) -> None:
    async def main() -> None:
        seen: list[tuple[int, Observation]] = []
        medium = SimMedium(
            scenario, time_scale=scale, observer=lambda at, what: seen.append((at, what))
        )
        addresses = [node.address for node in scenario.nodes]
        sides = [Side(medium.link(address, config), address) for address in addresses]
        for side in sides:
            await side.open()
        await body(medium, sides, seen)
        for side in sides:
            await side.close()
            side.receiver.raise_faults()
        medium.close()

    run(main())


def test_frame_takes_airtime_and_propagation_delay_at_any_time_scale() -> None:
    async def body(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        near, far = sides
        called_at = time.monotonic_ns()
        report = await near.send(bytes(64))
        await far.hears(bytes(64))
        expected_s = (0.1503 + 64 * 0.011094) / SCALE
        lasted_s = (report.finished_at - report.started_at) / NS_PER_S
        assert lasted_s == pytest.approx(expected_s, abs=1e-6)
        frame = far.receiver.frames[0]
        assert frame.received_at - called_at >= round((expected_s + 1.0 / SCALE) * NS_PER_S)
        assert frame.metrics.propagation_s == pytest.approx(1.0 / SCALE)
        assert near.link.capabilities.propagation_s == pytest.approx(1.0 / SCALE)
        emission = next(what for _, what in seen if isinstance(what, Emission))
        reception = next(what for _, what in seen if isinstance(what, Reception))
        assert reception.arrival.ends_at - emission.ends_at == NS_PER_S

    case(channel(0.0, 1500.0), body)


def test_addressed_frame_is_for_one_modem_and_an_unaddressed_modem_hears_it_too() -> None:
    for addressed, heard in ((True, [0, 1, 0]), (False, [0, 1, 1])):

        async def body(
            medium: SimMedium,
            sides: list[Side],
            seen: list[tuple[int, Observation]],
            heard: list[int] = heard,
        ) -> None:
            await sides[0].send(b"for two", 2)
            await sides[0].send(b"for all")
            for side in sides[1:]:
                await side.receiver.wait(
                    "for all",
                    lambda side=side: b"for all" in side.receiver.received_bytes,  # type: ignore[misc]
                    10.0,
                )
            assert [len(side.receiver.frames) for side in sides] == [
                0, 1 + heard[1], 1 + heard[2]
            ]  # fmt: skip

        case(channel(0.0, 100.0, 200.0), body, config=SimConfig(addressed=addressed))


def test_frames_that_meet_at_a_receiver_are_lost_there() -> None:
    async def body(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        ids = [sides[0].transmit(bytes(64)), sides[2].transmit(bytes(64))]
        await sides[0].report(ids[0])
        await sides[2].report(ids[1])
        await sides[1].receiver.wait(
            "silence", lambda: sides[1].receiver.carrier == [True, False], 10.0
        )
        assert not sides[1].receiver.frames
        outcomes = {what.outcome for _, what in seen if isinstance(what, Reception)}
        assert Outcome.RECEIVED not in outcomes

    case(channel(0.0, 100.0, 200.0, collisions="protocol"), body)


def test_half_duplex_modem_does_not_hear_while_it_transmits() -> None:
    async def body(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        ids = [side.transmit(bytes(64)) for side in sides]
        for side, transmission_id in zip(sides, ids, strict=True):
            await side.report(transmission_id)
            await side.receiver.wait("silence", _quiet(side), 10.0)
        assert {what.outcome for _, what in seen if isinstance(what, Reception)} == {
            Outcome.HALF_DUPLEX
        }

    case(channel(0.0, 100.0), body)


def _quiet(side: Side) -> Callable[[], bool]:
    return lambda: side.receiver.carrier == [True, False]


def test_modem_takes_a_frame_within_its_gap_and_waits() -> None:
    async def body(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        near = sides[0]
        await near.report(near.transmit(b"one"))
        report = await near.report(near.transmit(b"two"))
        assert report.outcome is TransmitOutcome.SENT
        first, second = (what for _, what in seen if isinstance(what, Emission))
        assert second.started_at >= first.ready_at

    case(channel(0.0, 100.0), body)


def test_damaged_frames_reach_only_a_modem_without_a_check() -> None:
    # So far that nearly all is lost by noise, and noticed.
    far_channel = channel(0.0, 5000.0, channel="sea", seed=3)
    for checked in (True, False):

        async def body(
            medium: SimMedium,
            sides: list[Side],
            seen: list[tuple[int, Observation]],
            checked: bool = checked,
        ) -> None:
            for _ in range(10):
                await sides[0].send(bytes(64))
            await sides[1].receiver.wait(
                "end",
                lambda: (
                    len([what for _, what in seen if isinstance(what, Reception)]) == 10
                    and sides[1].receiver.carrier[-1:] in ([], [False])
                ),
                10.0,
            )
            whole = [frame.frame_bytes == bytes(64) for frame in sides[1].receiver.frames]
            received = sum(what.is_received for _, what in seen if isinstance(what, Reception))
            assert whole.count(True) == received < 10
            assert (whole.count(False) == 0) is checked
            assert sides[1].link.capabilities.checked is checked

        case(far_channel, body, config=SimConfig(checked=checked), scale=200.0)


def test_scenario_with_unnoticed_damage_makes_modems_that_do_not_check() -> None:
    async def body(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        assert not sides[1].link.capabilities.checked
        await sides[0].send(bytes(64))
        await sides[1].receiver.wait("frame", lambda: sides[1].receiver.frames, 10.0)
        assert sides[1].receiver.frames[0].frame_bytes != bytes(64)

    case(channel(0.0, 100.0, faults=FaultSpec(corrupt=1.0)), body)


def test_duplicates_and_losses_of_the_scenario_happen() -> None:
    async def duplicates(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        await sides[0].send(b"twice")
        await sides[1].hears(b"twicetwice")

    async def losses(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        await sides[0].send(b"never")
        await sides[1].receiver.wait("silence", _quiet(sides[1]), 10.0)
        assert not sides[1].receiver.frames

    case(channel(0.0, 100.0, faults=FaultSpec(duplicate=1.0)), duplicates)
    case(channel(0.0, 100.0, loss=LossSpec(frame=1.0)), losses)


def test_unframed_modem_delivers_pieces() -> None:
    async def body(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        sent = bytes(range(64))
        for _ in range(4):
            await sides[0].send(sent)
        await sides[1].hears(4 * sent)
        assert len(sides[1].receiver.frames) > 4
        assert not sides[1].link.capabilities.framed

    case(channel(0.0, 100.0), body, config=SimConfig(framed=False))


def test_attach_and_detach_are_observed_and_a_place_is_taken_once() -> None:
    async def body(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        assert [what for _, what in seen] == [Attached(1), Attached(2)]
        for address, reason in ((1, "taken by another modem"), (9, "no node 9; it has 1, 2")):
            second = Side(medium.link(address), address)
            with pytest.raises(LinkOpenError, match=reason):
                await second.open()
        await sides[0].close()
        assert seen[-1][1] == Detached(1)
        again = Side(medium.link(1), 1)
        await again.open()
        await again.send(b"again")
        await sides[1].hears(b"again")
        await again.close()

    case(channel(0.0, 100.0), body)


def test_closed_link_may_be_opened_again() -> None:
    async def body(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        for _ in range(3):
            await sides[0].close()
            sides[0] = Side(sides[0].link, 1)
            await sides[0].open()
        with pytest.raises(LinkOpenError, match="open already"):
            await sides[0].link.open(sides[0].receiver)

    case(channel(0.0, 100.0), body)


def test_silent_channel_has_no_timer() -> None:
    async def body(
        medium: SimMedium, sides: list[Side], seen: list[tuple[int, Observation]]
    ) -> None:
        await sides[0].send(b"x")
        await sides[1].receiver.wait("silence", _quiet(sides[1]), 10.0)
        await asyncio.sleep(0)
        assert medium.is_quiet

    case(channel(0.0, 100.0), body)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_wrong_time_scale_is_refused(scale: float) -> None:
    with pytest.raises(ConfigError, match="time scale"):
        SimMedium(channel(0.0, 1.0), time_scale=scale)
