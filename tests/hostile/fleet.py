"""A fleet with one stream of every kind, in variants that do not understand each other."""

import random
from typing import Any, Final

import msgspec

from zacoustic.core.base.qos import Forward, Priority, Qos, Reliability, Stamp
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable

RAW: Final = 1
"""Opaque, best effort."""
NAV: Final = 2
"""Typed and dense."""
SHAPE: Final = 3
"""Typed, in records, one key for each part."""
ALARM: Final = 4
"""Real time, best effort."""
VIEW: Final = 5
"""On demand, best effort."""
BLOB: Final = 6
"""Opaque and dense."""
LOG: Final = 10
"""Reliable, journalled, of any size."""
STOP: Final = 11
"""Reliable, real time, for the first node."""
LIGHT: Final = 12
"""Reliable, not journalled, one key for each part."""
DIARY: Final = 13
"""Reliable and on demand."""
ARM: Final = 20
"""A service of the first node."""
GOTO: Final = 30
"""An action of the first node."""

SERVER: Final = 1
BEST_EFFORT: Final = (RAW, NAV, SHAPE, ALARM, VIEW, BLOB)
RELIABLE: Final = (LOG, STOP, LIGHT, DIARY)
WITH_PARTS: Final = (SHAPE, LIGHT)
ON_DEMAND: Final = (VIEW, DIARY)
PARTS: Final = ("bow", "stern")
TICKETS: Final = 1 << 24
"""Each value carries a number below this, so that it is known again."""

_IDS: Final = (
    RAW, NAV, SHAPE, ALARM, VIEW, BLOB, LOG, STOP, LIGHT, DIARY, ARM, GOTO, 40, 41, 50, 175,
)  # fmt: skip
_PART: Final = (Wildcard(name="part", values=PARTS),)


def table(addresses: range, *, variant: int = 0, server: int = SERVER) -> StreamTable:
    """Return the table of a fleet.

    Args:
        addresses: Its nodes.
        variant: 0: as the constants above say. Others: of another fleet, where the same ids are
            other kinds, have other types, or are missing.
        server: Who serves and pursues goals.
    """
    specs = [spec for spec in _specs(server) if variant == 0 or (spec.stream_id + variant) % 3]
    if variant:
        specs = [_moved(spec, variant) for spec in specs]
    top = TICKETS if variant == 0 else TICKETS * 8 + variant
    types = [
        TypeSpec(
            name="Nav",
            fields=(
                FieldSpec(name="ticket", type="uint32", range=(0, top)),
                FieldSpec(name="depth", type="float64", range=(0, 1000 + variant), step=0.5),
                FieldSpec(name="note", type="string", max_length=12),
            ),
        )
    ]
    nodes = {address: f"n{address}" for address in addresses}
    return StreamTable(specs, types=TypeTable(types), nodes=nodes)


def value_of(stream_id: int, ticket: int, size_bytes: int) -> Any:
    """Return the value with a ticket; the rest of it follows from the ticket."""
    if stream_id in (NAV, SHAPE):
        return {"ticket": ticket, "depth": ticket % 2000 / 2, "note": f"{ticket:x}"}
    filler = random.Random(ticket).randbytes(max(0, size_bytes - 3))
    return ticket.to_bytes(3, "big") + filler


def ticket_of(value: Any) -> int | None:
    """Return the ticket in a value; None: there is none in it."""
    if isinstance(value, dict) and isinstance(value.get("ticket"), int):
        return int(value["ticket"])
    if isinstance(value, bytes) and len(value) >= 3:
        return int.from_bytes(value[:3], "big")
    return None


def _specs(server: int) -> list[StreamSpec]:
    reliable = Reliability.RELIABLE
    return [
        TopicSpec(stream_id=RAW, name="{node}/raw", qos=Qos(depth=4, stamp=Stamp.AGE)),
        TopicSpec(
            stream_id=NAV, name="{node}/nav", type_name="Nav", codec="dense", qos=Qos(depth=2)
        ),
        TopicSpec(
            stream_id=SHAPE,
            name="{node}/shape/{part}",
            type_name="Nav",
            wildcards=_PART,
            codec="packed",
            qos=Qos(depth=4),
        ),
        TopicSpec(
            stream_id=ALARM, name="{node}/alarm", qos=Qos(depth=4, priority=Priority.REAL_TIME)
        ),
        TopicSpec(stream_id=VIEW, name="{node}/view", qos=Qos(depth=4, forward=Forward.ON_DEMAND)),
        TopicSpec(
            stream_id=BLOB,
            name="{node}/blob",
            codec="dense",
            qos=Qos(depth=8, linger_s=2.0),
        ),
        TopicSpec(
            stream_id=LOG,
            name="{node}/log",
            qos=Qos(depth=100, reliability=reliable),
            journal=True,
        ),
        TopicSpec(
            stream_id=STOP,
            name="stop",
            subscribers=(server,),
            qos=Qos(depth=8, reliability=reliable, priority=Priority.REAL_TIME),
            journal=True,
        ),
        TopicSpec(
            stream_id=LIGHT,
            name="{node}/light/{part}",
            wildcards=_PART,
            qos=Qos(depth=8, reliability=reliable),
            journal=False,
        ),
        TopicSpec(
            stream_id=DIARY,
            name="{node}/diary",
            qos=Qos(depth=8, reliability=reliable, forward=Forward.ON_DEMAND),
            journal=True,
        ),
        ServiceSpec(stream_id=ARM, name="arm", server=server, timeout_s=300.0),
        ActionSpec(
            stream_id=GOTO,
            name="goto",
            server=server,
            timeout_s=300.0,
            result_timeout_s=600.0,
            feedback_interval_s=5.0,
        ),
    ]


def _moved(spec: StreamSpec, variant: int) -> StreamSpec:
    """Give a stream another id, so that a byte means another kind, or one that only they have."""
    place = (_IDS.index(spec.stream_id) + variant) % len(_IDS)
    return msgspec.structs.replace(spec, stream_id=_IDS[place])
