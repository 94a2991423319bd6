"""What a seal makes of each kind of frame: its size and airtime, beside the same frame unsealed.

A seal in step takes five bytes, a head of one and a tag of four; a long head takes four more, a
strong frame four more in its tag. A link whose check is ours loses the four of its CRC.
"""

from collections import Counter
from collections.abc import Callable
from typing import Final

import pytest

from tests.virtual.fleet import line
from tests.virtual.sealed import SealedFleet
from tests.virtual.test_sealed import LOG, NAV, QUIET, table
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.testing.virtual import Modem, VirtualNetwork

Act = Callable[[VirtualNetwork], object]
CHECKS, OURS = Modem(), Modem(checked=False)
CRC_BYTES: Final = 4
SILENT: Final = ContactRules()
OBJECT: Final = bytes(range(256)) * 240
LINK = CHECKS.capabilities(profile_named(DEFAULT_PROFILE), 1.0)


def frames(
    act: Act, build: MakeEngine, modem: Modem, contact: ContactRules = SILENT
) -> list[TraceRecord]:
    """Return what both nodes of a quiet channel transmit in two hours."""
    sent: list[TraceRecord] = []
    network = VirtualNetwork(
        line(0, 800, **QUIET),
        table(),
        build=build,
        modem=modem,
        rules=TransmitRules(contact=contact),
        trace=lambda each: sent.append(each) if each.what == "transmit" else None,
    )
    act(network)
    network.run(until_s=7200)
    return sent


def size(record: TraceRecord) -> int:
    return len(record.frame) // 2


def usual(sent: list[TraceRecord], node: int) -> int:
    """Return the size of most frames of a node, bytes."""
    return Counter(size(each) for each in sent if each.node == node).most_common(1)[0][0]


def reports(network: VirtualNetwork) -> None:
    for number in range(100):
        network.at(5 + 10 * number, lambda: network.publish(1, NAV, b"x" * 10))


def samples(network: VirtualNetwork) -> None:
    for number in range(100):
        network.at(5 + 60 * number, lambda: network.publish(1, LOG, b"x" * 10))


def silence(network: VirtualNetwork) -> None:
    order = RemoteCommand(kind=CommandKind.SILENCE)
    network.at(5, lambda: network.apply(1, lambda each, now: each.commands.send(2, order, now)))


def photo(network: VirtualNetwork) -> None:
    network.at(5, lambda: network.publish(1, LOG, OBJECT))


@pytest.mark.parametrize("modem", [CHECKS, OURS], ids=["link checks", "check of ours"])
@pytest.mark.parametrize(
    ("act", "node", "plain_bytes", "contact"),
    [
        pytest.param(reports, 1, 11, SILENT, id="report"),
        pytest.param(samples, 1, 12, SILENT, id="reliable sample"),
        pytest.param(samples, 2, 3, SILENT, id="acknowledgement"),
        pytest.param(
            lambda network: network.at(5, lambda: network.publish(1, NAV, b"x")),
            2, 1, ContactRules(heartbeat_s=60), id="heartbeat",
        ),
    ],
)  # fmt: skip
def test_a_frame_in_step(
    act: Act, node: int, plain_bytes: int, contact: ContactRules, modem: Modem
) -> None:
    crc_bytes = 0 if modem is CHECKS else CRC_BYTES
    before = usual(frames(act, Engine, modem, contact), node)
    after = usual(frames(act, SealedFleet(), modem, contact), node)
    assert before == plain_bytes + crc_bytes
    assert after == plain_bytes + 5
    assert LINK.airtime_ns(after) == pytest.approx(LINK.airtime_ns(plain_bytes + 5), rel=0.01)


@pytest.mark.parametrize("modem", [CHECKS, OURS], ids=["link checks", "check of ours"])
def test_the_first_frame_of_a_life_introduces_its_sender(modem: Modem) -> None:
    """A HELLO has eight bytes; an introduction has them too, a long head and a tag."""
    hello, first = (
        size(frames(reports, build, modem)[0]) - 11 for build in (Engine, SealedFleet())
    )
    assert hello == 8 + (0 if modem is CHECKS else CRC_BYTES)
    assert first == 17


def test_an_order_is_strong() -> None:
    """It needs no table, and so no introduction: one byte less than 21 with their HELLO and 13."""
    order = frames(silence, SealedFleet(), CHECKS)[0]
    assert order.frame.startswith("e0")
    assert size(order) <= 21 + 13


@pytest.mark.parametrize(
    ("modem", "share"), [(CHECKS, 0.922), (OURS, 0.983)], ids=["link checks", "check of ours"]
)
def test_an_object_takes_longer(modem: Modem, share: float) -> None:
    """Sixty kilobytes: the sound that they take, without and with a seal, within one per cent.

    Fragments fill their frames, so that each long head has a frame of nine bytes of its own.
    """
    plain_ns, sealed_ns = (
        [LINK.airtime_ns(size(each)) for each in frames(photo, build, modem)]
        for build in (Engine, SealedFleet())
    )
    full_ns = LINK.airtime_ns(64)
    assert plain_ns.count(full_ns) / sealed_ns.count(full_ns) == pytest.approx(share, rel=0.01)
    assert sum(plain_ns) / sum(sealed_ns) == pytest.approx(share, rel=0.01)
