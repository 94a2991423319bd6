"""Two of DESERT's drivers on two emulated modems; one dialogue byte for byte as it was captured."""

from collections.abc import Callable

import pytest

from tests.links.evologics.emulator.desert_driver import (
    BURST_WAIT_S,
    FINAL,
    QUERIES,
    QUERY_EVERY_S,
    DesertDriver,
    Mode,
)
from tests.links.evologics.emulator.sea import Host, Sea
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.clock import ns_to_seconds
from zacoustic_evologics.at.notifications import RecvIm
from zacoustic_evologics.emulator import PortBytes

SCENARIO = Scenario(
    nodes=(
        NodeSpec(address=1, position=(0.0, 0.0, 10.0)),
        NodeSpec(address=32, position=(300.0, 0.0, 10.0)),
    ),
    channel="none",
)
TO_SINK = (
    b"AT*SENDIM,25,32,noack,"
    b"\x01\x01\x00\x00\x08\x0b\x00\x00\x01 \x12\x00\x12\x00R\x02\x88\x03\xb426\xb6\xb7\x16\x18\n"
)
TO_NODE = (
    b"AT*SENDIM,25,1,noack,"
    b" \x01\x00\x00\x08\x0b\x00\x00 \x01\x02\x12\x00\x12P\x02\x88\x83\xbb796\xb2\x16\x18\n"
)
NASTY = b"OK\r\nINITIATION LISTEN\r\n,,RECVIM,1,2\r\nERROR PHY OFF\r\n"
"""A packet with words that the driver chokes on anywhere else."""


class Aboard:
    """One driver at the port of its modem."""

    def __init__(self, sea: Sea, address: int, driver: DesertDriver) -> None:
        self.address = address
        self.driver = driver
        self.sea = sea
        self.host: Host = sea.host(address)
        self._seen = 0
        sea.hear(self.pump)

    def pump(self) -> None:
        """Read what the modem has said since."""
        new, self._seen = self.sea.outputs[self._seen :], len(self.sea.outputs)
        for _, output in new:
            if isinstance(output, PortBytes) and output.port_id == self.host.port_id:
                self.driver.take(output.content)

    def send(self, destination: int, content: bytes) -> list[str]:
        """Send a packet, and wait for its end as the driver does; return what it has read then."""
        read = self.driver.read
        before = len(read)
        self.say(self.driver.packet(destination, content))
        assert read[before] == "OK"
        if self.driver.mode is Mode.BURST:
            self._until(lambda: len(read) > before + 1, BURST_WAIT_S)
            return read[before + 1 :]
        for _ in range(QUERIES):
            self.say(b"AT?DI\n")
            if any(line.startswith(FINAL) for line in read[before + 1 :]):
                break
            self.sea.wait(QUERY_EVERY_S)
        return read[before + 1 :]

    def say(self, content: bytes) -> None:
        self.host.say(content)
        self.pump()

    def _until(self, condition: Callable[[], bool], limit_s: float) -> None:
        sea = self.sea
        end_s = ns_to_seconds(sea.fleet.now) + limit_s
        while not condition() and ns_to_seconds(sea.fleet.now) < end_s:
            sea.wait(0.05)


def two(
    mode: Mode = Mode.UNACKNOWLEDGED, *, extended: bool = False, **settings: int
) -> tuple[Sea, Aboard, Aboard]:
    """Return a node and a sink; the driver sets nothing, so all is as the modem was set before."""
    if extended:
        settings["ZF"] = 1
    sea = Sea(SCENARIO, settings=settings)
    node, sink = (Aboard(sea, each, DesertDriver(mode, extended=extended)) for each in (1, 32))
    return sea, node, sink


def test_captured_packets_pass_both_ways_with_the_captured_dialogue() -> None:
    sea = Sea(SCENARIO)
    node, sink = sea.host(1), sea.host(32)
    for sender, receiver, command in ((node, sink, TO_SINK), (sink, node, TO_NODE)):
        assert sender.say(command) == ["OK"]
        answers: list[str] = []
        while answers[-1:] != ["EMPTY"] and len(answers) < QUERIES:
            answers += sender.say(b"AT?DI\n")
            sea.wait(QUERY_EVERY_S)
        assert answers == ["DELIVERING"] * (len(answers) - 1) + ["EMPTY"]
        assert 2 <= len(answers) <= 4
        sea.run()
        record = receiver.all_of(RecvIm)[-1]
        assert record.payload == command.split(b",", 4)[4][:-1]
    assert TO_SINK.count(b",") == 4
    assert DesertDriver().packet(32, TO_SINK.split(b",", 4)[4][:-1]) == TO_SINK


def test_modem_says_nothing_before_it_is_spoken_to() -> None:
    sea, node, sink = two()
    sea.wait(60.0)
    assert sea.outputs == []
    assert node.driver.read == sink.driver.read == []


@pytest.mark.parametrize("extended", [False, True])
@pytest.mark.parametrize("mode", Mode)
def test_packets_of_any_bytes_pass_both_ways_in_each_mode(mode: Mode, extended: bool) -> None:
    sea, node, sink = two(mode, extended=extended)
    packets = [b"x", bytes(range(64)), NASTY, b"\r\n", b"\r", b"p0,", b",", bytes(64)]
    for sender, receiver in ((node, sink), (sink, node)):
        for packet in packets:
            read = sender.send(receiver.address, packet)
            assert read[-1].startswith(FINAL), (packet, read)
            sea.wait(3.0)
        assert receiver.driver.received == packets
    assert node.driver.wedged_by == sink.driver.wedged_by == ""


def test_sixty_packets_back_to_back_all_arrive() -> None:
    sea, node, sink = two()
    packets = [bytes([number]) * 25 for number in range(60)]
    for packet in packets:
        assert node.send(32, packet)[-1] == "EMPTY"
    sea.run()
    assert sink.driver.received == packets


def test_packet_of_more_than_an_instant_message_goes_in_two() -> None:
    for rest_bytes in (5, 22):
        sea, node, sink = two()
        parts = [bytes(range(64)), bytes(range(rest_bytes))]
        for part in parts:
            assert node.send(32, part)[-1] == "EMPTY"
        sea.run()
        assert sink.driver.received == parts


def test_slots_of_a_second_hold_a_packet_of_each() -> None:
    """Frames of 1 s with two slots, 0.3 s of guard in each: what DESERT's own script has."""
    sea, node, sink = two()
    for frame in range(100):
        for slot, (sender, receiver) in enumerate(((node, sink), (sink, node))):
            sea.run(frame + slot / 2)
            sender.say(sender.driver.packet(receiver.address, bytes([frame]) * 7))
            sender.say(b"AT?DI\n")
    sea.run()
    for receiver in (node, sink):
        assert receiver.driver.received == [bytes([frame]) * 7 for frame in range(100)]
        assert "BUSY" not in " ".join(receiver.driver.read)


@pytest.mark.parametrize("mode", [Mode.ACKNOWLEDGED, Mode.BURST])
def test_packet_that_nobody_receives_ends_in_an_answer_that_the_driver_takes(mode: Mode) -> None:
    sea, node, sink = two(mode, RI=0, RC=0)
    sink.host.say(b"ATS\n")
    read = node.send(32, b"anybody?")
    sea.run()
    assert {line.partition(",")[0] for line in read + node.driver.read} <= {
        "OK", "DELIVERING", "FAILED", "FAILEDIM",
    }  # fmt: skip
    assert node.driver.wedged_by == ""


def test_extended_protocol_mode_is_a_preset_since_the_driver_does_not_ask_for_it() -> None:
    sea, node, sink = two(extended=True)
    node.send(32, b"hello")
    sea.run()
    assert bytes(sink.host.raw).startswith(b"RECVIM,p0,5,1,32,noack,")
    assert sink.driver.received == [b"hello"]


def test_bursts_are_delivered_within_the_five_seconds_that_the_driver_waits() -> None:
    _, node, sink = two(Mode.BURST)
    assert node.send(32, b"hello") == ["DELIVERED,1,32"]
    assert sink.driver.received == [b"hello"]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (b"AT?S\n", "Remote Address: "), (b"AT&V\n", "Source Level: "), (b"AT?L\n", "3"),
        (b"AT!L3\n", "OK"), (b"AT?AL\n", "1"), (b"AT!AL1\n", "OK"), (b"ATZ1\n", "OK"),
    ],
)  # fmt: skip
def test_commands_that_the_driver_has_and_never_says_are_answered(
    command: bytes, words: str
) -> None:
    _, node, _ = two()
    assert words in "\n".join(node.host.say(command))


@pytest.mark.parametrize("is_told", [False, True])
def test_chatter_has_no_line_that_wedges_the_driver(is_told: bool) -> None:
    """Both at once, whatever the driver can say: refused, collided, not acknowledged, too long."""
    sea, node, sink = two(ZX=int(is_told), ZU=int(is_told))
    commands = [
        DesertDriver(mode, extended=extended).packet(destination, content)
        for mode in Mode
        for extended in (False, True)
        for destination in (32, 255, 7)
        for content in (b"x", bytes(64), bytes(65))
    ]
    for at in range(4 * len(commands)):
        node.say(commands[at % len(commands)])
        node.say(b"AT?DI\n")
        sink.say(TO_NODE if at % 3 else TO_NODE.replace(b"noack", b"ack"))
        sea.wait(0.37)
    sea.run()
    for sender, receiver in ((node, sink), (sink, node)):
        sender.send(receiver.address, b"still there")
        sea.wait(3.0)
        assert receiver.driver.wedged_by == ""
        assert receiver.driver.received[-1] == b"still there"
        assert not receiver.host.is_closed
    assert "BUSY" in " ".join(node.driver.read)
    assert sea.unrecognised() == []


@pytest.mark.parametrize(
    "line", ["INITIATION LISTEN", "ERROR NOT ACCEPTED", "ERROR PHY OFF", "ERROR OUT OF RANGE"]
)
def test_driver_is_wedged_by_what_has_wedged_the_real_one(line: str) -> None:
    driver = DesertDriver()
    driver.take(f"PHYON\r\nBUSY\r\n{line}\r\nRECVIM,1,1,32,noack,1,-40,100,0.0,x\r\n".encode())
    assert driver.wedged_by == line
    assert driver.received == []


def test_driver_reads_what_the_real_one_has_read() -> None:
    message = b"RECVIM,7,1,32,noack,1000,-40,100,0.0000,a\r\nOK,b\r\n"
    whole = b"SENDSTART,32,im,1,0\r\nPHYON\r\nOK\r\n" + 2 * message + b"DELIVEREDIM,32\r\n"
    for size in (1, 7, len(whole)):
        driver = DesertDriver()
        for start in range(0, len(whole), size):
            driver.take(whole[start : start + size])
        assert driver.received == [b"a\r\nOK,b", b"a\r\nOK,b"]
        assert [line[:6] for line in driver.read] == ["SENDST", "OK", "DELIVE"]
