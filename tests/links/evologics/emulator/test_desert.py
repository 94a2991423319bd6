"""What DESERT's driver for this modem says and waits for, byte for byte."""

import pytest

from tests.links.evologics.emulator.sea import Host, Sea
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic_evologics.at.notifications import RecvIm

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
WEDGING = (
    "INITIATION", "ERROR NOT ACCEPTED", "ERROR PHY OFF", "ERROR OUT OF RANGE",
    "ERROR BUFFER IS NOT EMPTY", "ERROR WRONG DESTINATION ADDRESS", "ERROR CONNECTION CLOSED",
    "ERROR PROTOCOL ID", "ERROR INTERNAL",
)  # fmt: skip


def exchange(sea: Sea, host: Host, command: bytes, final: tuple[str, ...]) -> list[str]:
    """Send, then ask every 200 ms until a final answer, ten times at most."""
    assert host.say(command) == ["OK"]
    answers: list[str] = []
    for _ in range(10):
        answers += host.say(b"AT?DI\n")
        if answers[-1] in final:
            break
        sea.wait(0.2)
    return answers


def test_packets_pass_both_ways_with_the_drivers_own_dialogue() -> None:
    sea = Sea(SCENARIO)
    node, sink = sea.host(1), sea.host(32)
    for sender, receiver, command in ((node, sink, TO_SINK), (sink, node, TO_NODE)):
        answers = exchange(sea, sender, command, ("EMPTY",))
        assert answers == ["DELIVERING"] * (len(answers) - 1) + ["EMPTY"]
        assert 2 <= len(answers) <= 4
        sea.run()
        record = receiver.all_of(RecvIm)[-1]
        assert record.payload == command.split(b",", 4)[4][:-1]
    assert TO_SINK.count(b",") == 4


def test_sixty_packets_back_to_back_all_arrive() -> None:
    sea = Sea(SCENARIO)
    node, sink = sea.host(1), sea.host(32)
    for _ in range(60):
        assert exchange(sea, node, TO_SINK, ("EMPTY",))[-1] == "EMPTY"
    sea.run()
    assert len(sink.all_of(RecvIm)) == 60


@pytest.mark.parametrize("loss", [False, True])
def test_acknowledged_packets_end_in_an_answer_that_the_driver_takes(loss: bool) -> None:
    sea = Sea(SCENARIO)
    node, sink = sea.host(1), sea.host(32)
    if loss:
        sink.say(b"ATS\n")
    command = TO_SINK.replace(b"noack", b"ack")
    answers = exchange(sea, node, command, ("EMPTY", "FAILED"))
    sea.run()
    everything = set(answers + node.lines())
    assert everything <= {"DELIVERING", "EMPTY", "FAILED", "DELIVEREDIM,32", "FAILEDIM,32"}


def test_extended_protocol_mode_is_a_preset_since_the_driver_does_not_ask_for_it() -> None:
    sea = Sea(SCENARIO, settings={"ZF": 1})
    node, sink = sea.host(1), sea.host(32)
    assert node.say(TO_SINK.replace(b"SENDIM,", b"SENDIM,p0,")) == ["OK"]
    sea.run()
    assert bytes(sink.raw).startswith(b"RECVIM,p0,25,1,32,noack,")


def test_bursts_are_delivered_within_the_five_seconds_that_the_driver_waits() -> None:
    sea = Sea(SCENARIO)
    node, _ = sea.host(1), sea.host(32)
    assert node.say(b"AT*SEND,5,32,hello\n") == ["OK"]
    sea.run(5.0)
    assert node.lines() == ["DELIVERED,1,32"]


def test_default_chatter_has_no_line_that_wedges_the_driver() -> None:
    sea = Sea(SCENARIO)
    node, sink = sea.host(1), sea.host(32)
    commands = (
        TO_SINK, TO_SINK.replace(b"noack", b"ack"), b"AT*SENDIM,1,255,noack,x\n",
        b"AT*SENDIM,1,255,ack,x\n", b"AT*SENDIM,65,32,noack," + bytes(65) + b"\n",
        b"AT*SEND,5,32,hello\n", b"AT?DI\n", b"AT*SENDIM,p0,1,32,noack,x\n",
    )  # fmt: skip
    for at in range(200):
        node.say(commands[at % len(commands)])
        sink.say(TO_NODE if at % 3 else TO_NODE.replace(b"noack", b"ack"))
        sea.wait(0.37)
    sea.run()
    said = b"".join(
        output.content for _, output in sea.outputs if hasattr(output, "content")
    ).decode("latin-1")
    assert "BUSY" in said
    assert [words for words in WEDGING if words in said] == []
