"""Frames of another fleet, in any order, whole or mutated: no engine raises at them."""

import functools
import random
from collections.abc import Callable

import pytest

from tests.core.rig import End
from tests.hostile import fleet, foreign, load
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

FRAMES = 1_000_000
AT_ONCE = 250
"""Frames in one run."""
MODEMS = (
    Modem(),
    Modem(addressed=False, checked=False),
    Modem(senses_carrier=False),
    Modem(mtu_bytes=40),
)
BLOCKS = 2
RELIABLE = Qos(reliability=Reliability.RELIABLE)
NODES = {1: "shore", 2: "vehicle"}


def listen(seed: int) -> None:
    """Let a fleet do its work while frames of others come in."""
    rng = random.Random(f"listen {seed}")
    modem = MODEMS[seed % len(MODEMS)]
    addresses = range(1, 4)
    table = fleet.table(addresses)
    nodes = [{"address": each, "position": [200 * each, 0, 10]} for each in addresses]
    network = VirtualNetwork(
        scenario_from_mapping({"nodes": nodes, "channel": "none", "seed": seed}, source="own"),
        table,
        modem=modem,
        digest=False,
    )
    strange = foreign.frames(1 + seed // len(MODEMS) % foreign.VARIANTS, modem)
    own = foreign.frames(0, modem)  # of a former life of this fleet, say
    at_s = 0.0
    place = 0
    for number in range(AT_ONCE):
        at_s += rng.choice((0.0, 0.1, 1.0, 5.0))
        # One after the other, as they were sent, for a while: transfers come to their end.
        place = rng.randrange(len(strange)) if rng.random() < 0.03 else place + 1
        frame = strange[place % len(strange)]
        if rng.random() < 0.1:
            frame = rng.choice(own)
        if rng.random() < 0.2:
            frame = foreign.mutated(rng, frame)
        address = rng.choice((frame.destination, frame.destination, 1, 2, 3))
        address = address if address in addresses else 1

        def hear(address: int = address, frame: foreign.Stranger = frame) -> None:
            network.apply(
                address,
                lambda engine, now: engine.handle_frame(
                    frame.received(now, addressed=modem.addressed), now
                ),
            )

        network.at(at_s, hear)
        if number % 5 == 0:
            speaker = rng.choice(addresses)
            say = load.anything(rng, speaker, table)

            def speak(speaker: int = speaker, say: load.Say = say) -> None:
                network.apply(speaker, lambda engine, now: load.said(engine, now, say))

            network.at(at_s, speak)
        if number % 50 == 49:
            network.at(at_s, functools.partial(network.restart, address))
    network.run(until_s=at_s + 100)


@pytest.mark.parametrize("block", range(BLOCKS))
def test_no_engine_raises_at_the_frames_of_another_fleet(
    sized: Callable[..., int], block: int
) -> None:
    # Each modem with two other fleets at least.
    for seed in range(block, sized(FRAMES // AT_ONCE, share=2 * len(MODEMS)), BLOCKS):
        try:
            listen(seed)
        except Exception as error:
            error.add_note(f"again: listen({seed})")
            raise


def test_object_of_a_stream_that_only_strangers_have_is_refused() -> None:
    """Its manifest comes before the tables are known to agree, its end behind that."""
    theirs = StreamTable([TopicSpec(stream_id=99, name="photo", qos=RELIABLE)], nodes=NODES)
    ours = StreamTable([TopicSpec(stream_id=10, name="log", qos=RELIABLE)], nodes=NODES)
    stranger, friend, victim = End(2, theirs), End(2, ours), End(1, ours, epoch=7)
    stranger.engine.publish(99, bytes(range(256)) * 4, 0)
    strange = sent(stranger, seconds=200)
    assert len(strange) > 20
    for at_s, frame_bytes in enumerate(strange[:-1]):
        victim.hear(frame_bytes, at_s * NS_PER_S, source=2)
        victim.send(at_s * NS_PER_S)
    friend.engine.publish(10, b"friend", 0)
    now = 1000 * NS_PER_S
    for frame_bytes in sent(friend, seconds=60):
        now += NS_PER_S
        victim.hear(frame_bytes, now, source=2)
        victim.send(now)
    for frame_bytes in strange * 2:
        now += NS_PER_S
        victim.hear(frame_bytes, now, source=2)
        victim.send(now)
    assert [event.value for event in victim.got(SampleReceived)] == [b"friend"]


def sent(end: End, *, seconds: int) -> list[bytes]:
    """Return what an engine says by itself."""
    frames = []
    for at in range(seconds * 10):
        now = at * NS_PER_S // 10
        end.engine.handle_timeout(now)
        transmission = end.send(now)
        if transmission is not None:
            frames.append(transmission.frame_bytes)
    return frames
