"""Two ends that call services, for tests: one asks, the other answers."""

from tests.core.rig import Rig, link
from zacoustic.core.engine.events import CallFailed, CallFailure, RequestReceived, ResponseReceived
from zacoustic.core.linktypes import Transmission
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable

NODES = {1: "shore", 2: "auv"}
TYPES = TypeTable([TypeSpec(name="N", fields=(FieldSpec(name="n", type="uint8", range=(0, 9)),))])


def fleet(
    server: int = 2, *, journal: bool = True, name: str = "arm", nodes: int = 2
) -> StreamTable:
    return StreamTable(
        [
            ServiceSpec(stream_id=20, name=name, server=server, timeout_s=10, journal=journal),
            ServiceSpec(
                stream_id=21,
                name="count",
                server=2,
                request_type="N",
                response_type="N",
                timeout_s=10,
            ),
            TopicSpec(stream_id=1, name="a"),
        ],
        types=TYPES,
        nodes=NODES | {address: f"n{address}" for address in range(3, nodes + 1)},
    )


def ends(**settings: float) -> Rig:
    return Rig({1: fleet(), 2: fleet()}, capabilities=link(**settings))


def acquainted() -> Rig:
    """Return two ends that have confirmed each other."""
    rig = ends()
    rig.publish(1, 1, b"a")
    rig.publish(2, 1, b"b")
    rig.run(1)
    rig.publish(1, 1, b"a")
    rig.publish(2, 1, b"b")
    rig.run(1)
    assert rig[1].engine.peers() == {2: True}
    assert rig[2].engine.peers() == {1: True}
    rig.frames.clear()
    return rig


def call(rig: Rig, value: object = b"please", *, stream_id: int = 20, **settings: float) -> int:
    return rig[1].engine.call(stream_id, value, rig.now, **settings)


def requests(rig: Rig) -> list[RequestReceived]:
    return rig[2].got(RequestReceived)


def answer(rig: Rig, value: object = b"done", number: int = -1) -> bool:
    return rig[2].engine.reply(requests(rig)[number].call, value, rig.now)


def failures(rig: Rig) -> list[tuple[int, CallFailure, str]]:
    return [(event.call_id, event.failure, event.text) for event in rig[1].got(CallFailed)]


def entries(rig: Rig) -> list[str]:
    return [name for name in rig[2].journal if name.startswith("call/")]


def responses(rig: Rig) -> list[tuple[int, object]]:
    return [(event.call_id, event.value) for event in rig[1].got(ResponseReceived)]


def sent_by(rig: Rig, address: int) -> list[bytes]:
    return [sent.frame_bytes for source, sent in rig.frames if source == address]


def to_nobody(source: int, node: int, transmission: Transmission) -> bool:
    return False
