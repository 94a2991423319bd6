"""No frame is ever larger than its link takes, whatever is in it."""

import contextlib
import random
from collections.abc import Callable

from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.core.rig import Pass, Rig, link
from tests.hostile import fleet, foreign, load
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, GoalStatus, RequestReceived
from zacoustic.core.linktypes import LinkCapabilities, Transmission
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access.spec import AccessSpec, PollingSpec, TdmaSpec
from zacoustic.core.transport.actions.events import GoalReceived
from zacoustic.errors import LocalError, PayloadTooLargeError
from zacoustic.testing.virtual import Modem

assert settings.default is not None
USUAL = settings.default
ADDRESSES = range(1, 4)
ACCESS: tuple[AccessSpec | None, ...] = (
    None,
    TdmaSpec(slots=(1, 2, 3), slot_s=20.0, clock_error_s=0.01, guard_s=2.0, clock=1, beacon_s=60.0),
    PollingSpec(poller=1, nodes=(2, 3)),
)
STEP = st.tuples(
    st.sampled_from(ADDRESSES), st.integers(0, 1 << 30), st.sampled_from((0.0, 0.1, 5.0, 60.0))
)


def capabilities(lacks: dict[str, bool], mtu_bytes: int) -> LinkCapabilities:
    """Return a link with an MTU, or the least one where it has room for nothing."""
    least = (
        8 + 2 * (not lacks["addressed"]) + 4 * (not lacks["checked"]) + 3 * (not lacks["framed"])
    )
    return link(mtu_bytes=max(mtu_bytes, least), bit_rate_bps=5_000, **lacks)


@settings(max_examples=USUAL.max_examples // 5)  # each is minutes of three engines
@given(
    mtu_bytes=st.integers(8, 80) | st.integers(8, 1024),
    lacks=st.fixed_dictionaries(
        {name: st.booleans() for name in ("addressed", "checked", "framed")}
    ),
    access=st.sampled_from(ACCESS),
    steps=st.lists(STEP, min_size=10, max_size=60),
    loss=st.sampled_from((0.0, 0.3)),
)
@example(  # a SUBSCRIBE has no room beside a TAG
    mtu_bytes=8,
    lacks={"addressed": False, "checked": False, "framed": False},
    access=None,
    steps=[*[(1, 0, 0.0)] * 9, (1, 1_037_023, 0.0)],
    loss=0.0,
)
@example(  # an ACK has no room at all: the engine must not wait for its frame
    mtu_bytes=8,
    lacks={"addressed": True, "checked": True, "framed": True},
    access=None,
    steps=[
        *[(1, 7190491, 0.0), (1, 7190491, 0.0), (1, 255, 0.1), (2, 42599, 5.0), (1, 262403, 5.0)],
        *[(3, 3640618, 0.1), (1, 1048577, 5.0), (3, 207, 0.1), (3, 2689, 5.0), (3, 3719, 60.0)],
        *[(2, 67, 60.0), (2, 102698276, 0.1), (3, 1_073_741_824, 0.1), (2, 84, 0.1)],
        *[(1, 12057, 0.1), (1, 4683, 60.0), (1, 692312663, 60.0), (1, 214866063, 5.0)],
        *[(1, 122766, 0.0), (2, 1126, 5.0), (2, 7291, 0.0), (2, 71731218, 0.0), (2, 5851, 0.1)],
        *[(1, 26, 5.0), (3, 1631555, 60.0), (3, 257, 60.0)],
    ],
    loss=0.0,
)
@example(  # feedback about a goal has no room, and its application is told so
    mtu_bytes=17,
    lacks={"addressed": False, "checked": False, "framed": True},
    access=None,
    steps=[*[(1, 0, 0.0)] * 9, (2, 2273, 0.0), (1, 0, 0.0)],
    loss=0.0,
)
@example(  # a HELLO has no room beside the feedback about an object
    mtu_bytes=8,
    lacks={"addressed": False, "checked": False, "framed": False},
    access=TdmaSpec(
        slots=(1, 2, 3), slot_s=20.0, guard_s=2.0, clock=1, beacon_s=60.0, clock_error_s=0.01
    ),
    steps=[
        *[(1, 1, 5.0), (3, 0, 5.0), *[(1, 0, 0.0)] * 3],
        *[(1, 0, 5.0), (1, 0, 0.0), (1, 0, 5.0), (1, 0, 0.0), (1, 16_668_732, 0.0)],
    ],
    loss=0.3,
)
def test_no_frame_is_larger_than_the_mtu(
    mtu_bytes: int,
    lacks: dict[str, bool],
    access: AccessSpec | None,
    steps: list[tuple[int, int, float]],
    loss: float,
) -> None:
    rng = random.Random(len(steps))
    table = fleet.table(ADDRESSES)
    rules = TransmitRules(access=access, contact=ContactRules(heartbeat_s=30.0))
    limits = capabilities(lacks, mtu_bytes)
    try:
        rig = Rig(
            {address: fleet.table(ADDRESSES) for address in ADDRESSES},
            capabilities=limits,
            rules=dict.fromkeys(ADDRESSES, rules),
        )
    except LocalError:
        return  # such an access does not fit this link, and says so
    strange = foreign.frames(1, Modem())
    for address in ADDRESSES:
        rig[address].engine.handle_clock(0, 0, 0)

    def passes(source: int, node: int, transmission: Transmission) -> bool:
        return rng.random() >= loss

    for address, seed, wait_s in steps:
        end, draw = rig[address], random.Random(seed)
        load.said(end.engine, rig.now, load.anything(draw, address, table))
        if limits.addressed and draw.random() < 0.2:
            frame = draw.choice(strange)
            end.hear(frame.frame_bytes, rig.now, source=frame.source, destination=address)
        answer(end.engine, end.events, rig.now)
        end.events.clear()
        rig.run(wait_s, passes)
    rig.run(60.0, passes)
    for _, transmission in rig.frames:  # `End.poll` has looked at each as well
        assert len(transmission.frame_bytes) <= limits.mtu_bytes


def answer(engine: Engine, events: list[Event], now: int) -> None:
    """Answer what an application is asked."""
    for event in events:
        if isinstance(event, RequestReceived):
            with contextlib.suppress(LocalError):
                engine.reply(event.call, b"y", now)
        elif isinstance(event, GoalReceived):
            goal = event.goal
            engine.actions.accept(goal, now)
            with contextlib.suppress(PayloadTooLargeError):
                engine.actions.publish_feedback(goal, b"half", now)
            with contextlib.suppress(PayloadTooLargeError):
                engine.actions.finish(goal, GoalStatus.SUCCEEDED, b"done", now)


def half_of_the_frames(rng: random.Random) -> Pass:
    """Lose the others."""
    return lambda source, node, sent: rng.random() < 0.5


def test_dense_samples_beside_open_ended_records_fit(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        rng = random.Random(seed)
        mtu_bytes, blob_bytes = rng.randint(30, 70), rng.randint(3, 20)
        tables = {address: fleet.table(ADDRESSES) for address in (1, 2)}
        rig = Rig(tables, capabilities=link(mtu_bytes=mtu_bytes))
        for _ in range(20):
            for _ in range(rng.randint(1, 8)):
                is_dense = rng.random() < 0.4
                stream_id = fleet.BLOB if is_dense else fleet.LIGHT
                value = rng.randbytes(3) + bytes(blob_bytes - 3 if is_dense else rng.randrange(4))
                instance = () if is_dense else (rng.randrange(2),)
                with contextlib.suppress(PayloadTooLargeError):
                    rig.publish(1, stream_id, value, instance=instance)
            rig.run(rng.choice((0.5, 3.0)), half_of_the_frames(rng))
        for _, transmission in rig.frames:
            assert len(transmission.frame_bytes) <= mtu_bytes, f"seed {seed}"
