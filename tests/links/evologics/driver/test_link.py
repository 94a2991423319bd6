"""The shell: real ports, the loop, the link contract."""

import asyncio
import socket
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from tests.links.evologics.driver.bench import ScriptedModem
from tests.links.evologics.driver.ports import SerialModem, TcpModem
from tests.runtime.loop_checks import run
from zacoustic.bytestream import ByteStream
from zacoustic.core.linktypes import LinkState, Transmission, TransmitOutcome
from zacoustic.errors import LinkClosedError, LinkOpenError
from zacoustic.testing.linkpair import RecordingReceiver, Side
from zacoustic_evologics.at.framing import SERIAL_LINE_END, Framing, Interpreter
from zacoustic_evologics.at.notifications import ImFlag, RecvIm
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.link import EvologicsLink

has_terminals = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
Port = TcpModem | SerialModem


def link_to(address: str, config: EvologicsConfig | None = None, node: int = 1) -> EvologicsLink:
    stream = ByteStream(address, first_delay_s=0.02, last_delay_s=0.1)
    return EvologicsLink(stream, config, node_address=node)


@asynccontextmanager
async def opened(port: Port, config: EvologicsConfig | None = None) -> AsyncIterator[Side]:
    await port.open()
    side = Side(link_to(port.address, config), 1)
    try:
        await side.open()
        yield side
        side.receiver.raise_faults()
    finally:
        await side.close()
        await port.close()
    side.receiver.raise_faults()


@has_terminals
@pytest.mark.parametrize("kind", [TcpModem, SerialModem])
@pytest.mark.parametrize("framing", Framing)
def test_frames_pass_both_ways_on_a_real_port(kind: type[Port], framing: Framing) -> None:
    interpreter = Interpreter.NET if framing is Framing.LINES else Interpreter.AT
    line_end = SERIAL_LINE_END if kind is SerialModem else b"\n"
    modem = ScriptedModem(interpreter, framing, line_end=line_end)

    async def main() -> None:
        async with opened(kind(modem)) as side:
            report = await side.send(b"to all")
            assert report.detail.startswith("SENDEND,255,im")
            modem.say(
                RecvIm(
                    payload=b"back\r\n", source=2, destination=1, flag=ImFlag.NOACK,
                    duration_us=204_800, rssi_db=-45, integrity=133, velocity_m_s=0.1,
                )
            )  # fmt: skip
            await side.hears(b"back\r\n")
            told = side.link.diagnostics()
            assert told["connections"] == 1
            assert told["state"] == "ready"
        states = [state for state, _ in side.receiver.states]
        assert states[0] is LinkState.OPENING
        assert states[-1] is LinkState.UP

    run(main())


def test_cut_connection_is_down_then_aborted_then_up_again() -> None:
    async def main() -> None:
        port = TcpModem(ScriptedModem())
        async with opened(port) as side:
            transmission_id = side.transmit(bytes(64))
            port.cut()
            report = await side.report(transmission_id)
            assert report.outcome is TransmitOutcome.ABORTED
            assert side.receiver.states[-1][0] is LinkState.DOWN
            await side.receiver.wait("UP", lambda: side.is_up, 10.0)
            assert len(port.modem.sent) <= 1
            await side.send(b"again")

    run(main())


@has_terminals
def test_serial_port_that_is_pulled_is_down() -> None:
    async def main() -> None:
        port = SerialModem(ScriptedModem())
        async with opened(port) as side:
            transmission_id = side.transmit(bytes(64))
            port.unplug()
            assert (await side.report(transmission_id)).outcome is TransmitOutcome.ABORTED
            assert side.receiver.states[-1][0] is LinkState.DOWN
            assert not side.is_up

    run(main())


def test_modem_that_falls_silent_costs_the_connection_and_comes_back() -> None:
    async def main() -> None:
        modem = ScriptedModem()
        port = TcpModem(modem)
        async with opened(port, EvologicsConfig(reply_s=0.05)) as side:
            feed = modem.feed
            modem.feed = lambda raw: None  # type: ignore[method-assign]
            report = await side.report(side.transmit(b"heard?"))
            assert (report.outcome, report.detail) == (
                TransmitOutcome.ABORTED,
                "the modem does not answer",
            )
            modem.feed = feed  # type: ignore[method-assign]
            await side.receiver.wait("UP", lambda: side.is_up, 10.0)
            assert side.link.diagnostics()["connections"] != 1
            await side.send(b"heard")

    run(main())


def test_open_says_what_is_wrong_with_the_modem() -> None:
    async def main() -> None:
        port = TcpModem(ScriptedModem())
        await port.open()
        link = link_to(port.address, node=7)
        with pytest.raises(LinkOpenError, match="address 1, this node 7") as caught:
            await link.open(RecordingReceiver())
        assert caught.value.hint == "set_address=true gives it 7"
        with pytest.raises(LinkClosedError):
            link.transmit(Transmission(transmission_id=1, frame_bytes=b"x"))
        await port.close()

    run(main())


def test_open_gives_up_on_a_modem_that_does_not_come() -> None:
    async def main() -> None:
        with socket.socket() as unused:  # bound, and nobody listens
            unused.bind(("127.0.0.1", 0))
            address = f"tcp:127.0.0.1:{unused.getsockname()[1]}"
            link = link_to(address, EvologicsConfig(wait_s=0.3))
            with pytest.raises(LinkOpenError) as caught:
                await link.open(RecordingReceiver())
            await link.close()
        words = f"no modem at {address} within 0.3 s: {address}: Connection refused"
        assert str(caught.value) == words

    run(main())


def test_link_can_be_opened_again_after_it_was_closed() -> None:
    async def main() -> None:
        port = TcpModem(ScriptedModem())
        await port.open()
        link = link_to(port.address)
        for _ in range(2):
            receiver = RecordingReceiver()
            await link.open(receiver)
            with pytest.raises(LinkOpenError, match="open already"):
                await link.open(receiver)
            transmission_id = 5
            link.transmit(Transmission(transmission_id=transmission_id, frame_bytes=b"x"))
            await link.close()
            assert [each.outcome for each in receiver.reports] == [TransmitOutcome.ABORTED]
            assert [state for state, _ in receiver.states][-1] is LinkState.UP
        await port.close()

    run(main())


def test_answers_to_reports_are_given_at_once_and_without_recursion() -> None:
    """The next frame from within the report of the last, as an engine does it."""

    async def main() -> None:
        port = TcpModem(ScriptedModem())
        await port.open()
        link = link_to(port.address)
        done = asyncio.Event()

        class Eager(RecordingReceiver):
            def transmit_finished(self, report: object) -> None:
                super().transmit_finished(report)  # type: ignore[arg-type]
                count = len(self.reports)
                if count < 40:
                    oversized = bytes(65) if count % 10 else b"fits"
                    link.transmit(Transmission(transmission_id=count, frame_bytes=oversized))
                else:
                    done.set()

        receiver = Eager()
        await link.open(receiver)
        link.transmit(Transmission(transmission_id=0, frame_bytes=bytes(65)))
        await done.wait()
        await link.close()
        await port.close()
        assert [each.transmission_id for each in receiver.reports] == list(range(40))
        assert not receiver.faults

    run(main())


def test_driver_adds_less_than_five_milliseconds_to_a_frame() -> None:
    """From `transmit` to the modem, and from the end of the sound to the report."""

    async def main() -> None:
        modem = ScriptedModem()
        async with opened(TcpModem(modem)) as side:
            feed, write = modem.feed, modem.write
            instants: list[int] = []

            def stamped_feed(raw: bytes) -> None:
                if b"*SENDIM" in raw:
                    instants.append(time.monotonic_ns())
                feed(raw)

            def stamped_write(raw: bytes) -> None:
                if raw.startswith(b"SENDEND"):
                    instants.append(time.monotonic_ns())
                write(raw)

            modem.feed, modem.write = stamped_feed, stamped_write  # type: ignore[method-assign]
            added_ns: list[int] = []
            for _ in range(7):
                instants.clear()
                called_at = time.monotonic_ns()
                report = await side.send(b"x")
                given_at, ended_at = instants
                added_ns.append((given_at - called_at) + (report.finished_at - ended_at))
            assert sorted(added_ns)[3] < 5_000_000

    run(main())
