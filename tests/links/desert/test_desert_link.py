import asyncio
import itertools
import random
from collections.abc import Callable

import pytest

from tests.links.desert.desert_rig import config, serve, side, standin
from tests.runtime.loop_checks import run
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.linktypes import LinkState, ReceivedFrame, Transmission, TransmitOutcome
from zacoustic.core.wire.envelope import Envelope, Opened
from zacoustic.errors import ConfigError, LinkClosedError, LinkOpenError
from zacoustic.link import convert_config
from zacoustic.testing.linkpair import RecordingReceiver, Side
from zacoustic_desert.config import DesertConfig
from zacoustic_desert.link import SUSPECT_FRAMES, DesertLink
from zacoustic_desert.server import StandInServer

FRAMES = [random.Random(number).randbytes(30) for number in range(50)]


async def raw(server: StandInServer, node: int) -> asyncio.StreamWriter:
    host, _, port = server.addresses[node].rpartition(":")
    _, writer = await asyncio.open_connection(host, int(port))
    return writer


async def gone(writer: asyncio.StreamWriter) -> None:
    writer.close()
    await writer.wait_closed()


def detail(each: Side) -> str:
    return each.receiver.states[-1][1]


@pytest.mark.parametrize("max_read_length", [64, 512])
def test_fifty_frames_back_to_back_become_fifty_packets(max_read_length: int) -> None:
    behind = standin(max_read_length=max_read_length)

    async def body(server: StandInServer) -> None:
        near, far = (side(server, node, max_read_length=max_read_length) for node in (0, 1))
        await near.open()
        await far.open()
        for frame_bytes in FRAMES:
            await near.send(frame_bytes)
        await far.hears(b"".join(FRAMES))
        assert behind.counts["sent"] == behind.counts["delivered"] == 50
        await near.close()
        await far.close()

    serve(body, behind)


@pytest.mark.parametrize("max_read_length", [64, 512])
def test_lost_packet_costs_its_frame_and_no_other(max_read_length: int) -> None:
    behind = standin(max_read_length=max_read_length, loss=0.2, seed=4)

    async def body(server: StandInServer) -> None:
        near, far = (side(server, node, max_read_length=max_read_length) for node in (0, 1))
        await near.open()
        await far.open()
        sender = Envelope(near.link.capabilities, 1)
        records = [bytes((number, *range(20))) for number in range(50)]
        for each in records:
            await near.send(sender.wrap(each, 2))
        delivered = behind.counts["sent"] - behind.counts["lost"]
        await far.receiver.wait(
            "all", lambda: len(far.receiver.received_bytes) == 30 * delivered, far.limit_s
        )
        receiver = Envelope(far.link.capabilities, 2)
        opened = [
            result
            for result in receiver.open(
                ReceivedFrame(frame_bytes=far.receiver.received_bytes, received_at=0)
            )
            if isinstance(result, Opened)
        ]
        assert len(opened) == delivered < 50
        await near.close()
        await far.close()

    serve(body, behind)


def test_desert_starts_late_goes_away_and_comes_back() -> None:
    async def body(server: StandInServer) -> None:
        near, far = side(server, 0), side(server, 1)
        opening = asyncio.ensure_future(near.open())
        states = near.receiver.states
        await near.receiver.wait("refusal", lambda: "Connection refused" in str(states), 5.0)
        waits = f"waits for DESERT at {server.addresses[0]}"
        hint = "(it listens a few seconds after its start, and serves one program per port)"
        assert states[0] == (LinkState.OPENING, f"{waits} {hint}")
        assert states[1] == (LinkState.OPENING, f"{waits}: Connection refused {hint}")
        server.listen()
        await opening
        assert states[-1] == (LinkState.UP, f"connected to DESERT at {server.addresses[0]}")
        await far.open()
        await near.send(b"one")
        await far.hears(b"one")

        transmission_id = near.transmit(b"two")
        await server.crash()
        report = await near.report(transmission_id)
        assert report.outcome is TransmitOutcome.ABORTED
        await near.receiver.wait("DOWN", lambda: not near.is_up, 5.0)
        assert "; waits for it to come back" in detail(near)
        await near.receiver.wait("refusal", lambda: detail(near).startswith(waits), 5.0)
        late = await near.report(near.transmit(b"three"))
        assert late.outcome is TransmitOutcome.ABORTED
        assert late.detail.startswith("no connection: waits for DESERT")

        far.receiver.frames.clear()
        server.listen()
        for each in (near, far):
            await each.receiver.wait("UP", lambda each=each: each.is_up, 10.0)  # type: ignore[misc]
        await near.send(b"four")
        await far.hears(b"four")
        assert near.link.diagnostics()["connections"] == 2
        await near.close()
        await far.close()

    serve(body, listens=False)


def test_deaf_connection_is_suspected_and_served_when_the_other_client_leaves() -> None:
    behind = standin()

    async def body(server: StandInServer) -> None:
        other = await raw(server, 0)
        near, far = side(server, 0), side(server, 1)
        await far.open()
        await near.open()
        for _ in range(SUSPECT_FRAMES):
            await near.send(b"hello")
        assert near.is_up
        assert "DESERT serves one program per port" in detail(near)
        readings = near.link.diagnostics()
        assert readings["frames_unheard"] == SUSPECT_FRAMES
        (finding,) = near.link.assess({"link": {"diagnostics": readings}})
        assert f"has taken {SUSPECT_FRAMES} frames" in finding.what
        assert "drop_out_of_order_ 0" in finding.cure
        assert behind.counts["read"] == 0
        await gone(other)
        await far.hears(b"hello" * SUSPECT_FRAMES)
        await far.send(b"at last")
        await near.hears(b"at last")
        assert detail(near) == f"connected to DESERT at {server.addresses[0]}"
        assert near.link.diagnostics()["frames_unheard"] == 0
        await near.close()
        await far.close()

    serve(body, behind)


def test_connection_that_takes_no_bytes_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(server: StandInServer) -> None:
        near = side(server, 0)
        await near.open()
        monkeypatch.setattr("zacoustic.link.bytestream.tcp.WRITE_LIMIT_BYTES", 3)
        report = await near.report(near.transmit(b"four"))
        assert report.outcome is TransmitOutcome.ABORTED
        assert "takes no more bytes" in report.detail
        assert LinkState.DOWN in [state for state, _ in near.receiver.states]
        await near.receiver.wait("UP", lambda: near.is_up, 5.0)
        await near.send(b"ok")
        await near.close()

    serve(body)


def test_link_can_be_opened_again_and_not_twice() -> None:
    async def body(server: StandInServer) -> None:
        near = side(server, 0)
        await near.open()
        with pytest.raises(LinkOpenError, match="is open already"):
            await near.link.open(RecordingReceiver())
        await near.close()
        again = Side(near.link, 1)
        await again.open()
        await again.send(b"again")
        await again.close()
        with pytest.raises(LinkClosedError, match="is not open"):
            again.transmit(b"closed")

    serve(body)


def test_waiting_link_closes_at_once_and_leaves_nothing() -> None:
    async def body(server: StandInServer) -> None:
        link = DesertLink(server.addresses[0], config())
        receiver = RecordingReceiver()
        await link.open(receiver)
        link.transmit(Transmission(transmission_id=1, frame_bytes=b"x"))
        await link.close()
        assert [report.outcome for report in receiver.reports] == [TransmitOutcome.ABORTED]

    serve(body, listens=False)


def test_next_frame_waits_for_the_pace_of_the_last_one() -> None:
    async def body(server: StandInServer) -> None:
        near = side(server, 0)
        await near.open()
        reports = [await near.send(bytes(size)) for size in (1, 64, 30, 1)]
        for before, after in itertools.pairwise(reports):
            assert after.started_at >= before.finished_at
        told = near.link.capabilities
        for report, size in zip(reports, (1, 64, 30, 1), strict=True):
            lasted_s = ns_to_seconds(report.finished_at - report.started_at)
            assert lasted_s == pytest.approx(ns_to_seconds(told.airtime_ns(size)))
        await near.close()

    serve(body)


@pytest.mark.parametrize("framing", ["native", "rmw_desert"])
def test_random_bytes_from_desert_do_no_harm(framing: str, count: Callable[[int], int]) -> None:
    async def main() -> None:
        settings = convert_config(DesertConfig, {"framing": framing}, source="locator")
        link = DesertLink.from_locator("127.0.0.1:4000", settings, node_address=1)
        rng, left, at = random.Random(7), count(1_000_000), 0
        while left:
            piece = rng.randbytes(min(left, rng.randint(1, 4096)))
            left, at = left - len(piece), at + 1
            link.bytes_received(piece, at)
        assert link.diagnostics()["state"] == "opening"

    run(main())


def test_packet_of_rmw_desert_behind_damage_comes_after_a_silence() -> None:
    behind = standin()

    async def body(server: StandInServer) -> None:
        near = side(server, 0, framing="rmw_desert")
        far = side(server, 1)
        await near.open()
        await far.open()
        await far.send(b"\x99" + bytes.fromhex("999903000a0055"))
        await near.hears(bytes.fromhex("000a00"))
        assert near.link.diagnostics()["bytes_discarded"] == 1
        await near.send(b"\x00\x0a\x07")
        await far.hears(bytes.fromhex("999903000a0755"))
        await near.close()
        await far.close()

    serve(body, behind)


@pytest.mark.parametrize("address", ["", "host", ":4000", "host:", "host:x", "host:0", "h:70000"])
def test_address_that_is_none_is_named(address: str) -> None:
    with pytest.raises(ConfigError, match=r"allowed: HOST:PORT, such as 127\.0\.0\.1:4000"):
        DesertLink.from_locator(address, DesertConfig(), node_address=1)


def test_settings_of_a_locator_are_checked() -> None:
    settings = {"max_read_length": "512", "period_s": "0.5", "framing": "rmw_desert"}
    converted = convert_config(DesertConfig, settings, source="desert/h:1")
    expected = DesertConfig(max_read_length=512, period_s=0.5, framing="rmw_desert")
    assert converted == expected
    for wrong in ({"framing": "cobs"}, {"max_read_length": "9000"}, {"period": "1"}):
        with pytest.raises(ConfigError, match="desert/h:1"):
            convert_config(DesertConfig, wrong, source="desert/h:1")
    for address in (0, 255):
        with pytest.raises(ConfigError, match=r"allowed: 1\.\.254"):
            DesertLink.from_locator("h:1", DesertConfig(), node_address=address)
