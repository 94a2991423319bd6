"""Which document has which struct, by the end of its key."""

import re
from collections.abc import Mapping
from typing import Any, Final, TypeVar

import msgspec

from zacoustic.status.channel import ChannelDocument, ObjectsDocument
from zacoustic.status.link import (
    BondDocument,
    CarryDocument,
    LedgerDocument,
    LinkDocument,
    RelayDocument,
    RouteDocument,
)
from zacoustic.status.node import (
    ClockDocument,
    ContactDocument,
    DroppedDocument,
    EventsDocument,
    JournalDocument,
    ModemDocument,
    NodeDocument,
    SealDocument,
)
from zacoustic.status.peers import (
    DirectionDocument,
    LateDocument,
    LostDocument,
    PeerRow,
    PositionDocument,
    RangeDocument,
)
from zacoustic.status.streams import StreamsDocument

_SINGLE: Final[dict[str, Any]] = {
    "node": NodeDocument,
    "link": LinkDocument,
    "relay": RelayDocument,
    "carry": CarryDocument,
    "ledger": LedgerDocument,
    "peers": dict[int, PeerRow],
    "streams": StreamsDocument,
    "objects": ObjectsDocument,
    "channel": ChannelDocument,
    "journal": JournalDocument,
    "dropped": DroppedDocument,
    "events": EventsDocument,
    "modem": ModemDocument,
    "clock": ClockDocument,
    "seal": SealDocument,
}
NAMED: Final[dict[str, Any]] = {
    "link": LinkDocument,
    "route": RouteDocument,
    "bond": BondDocument,
    "contact": ContactDocument,
}
"""Structs of documents with a name at the end of the key, by the chunk before the name."""
_OF_PEER: Final[dict[str, Any]] = {
    "range": RangeDocument,
    "position": PositionDocument,
    "direction": DirectionDocument,
    "lost": LostDocument,
    "late": LateDocument,
}
K = TypeVar("K")
# Anybody can put a key: a text with other digits than these is no address.
ADDRESS: Final = re.compile(r"[0-9]{1,3}")
"""An address in a key."""


def kind_of(name: str) -> Any:  # noqa: ANN401 (a struct, or a dictionary of them)
    """Return the struct of a document; None: nobody shows it.

    Args:
        name: The end of its key, after the address.
    """
    chunks = name.split("/")
    match len(chunks):
        case 1:
            return _SINGLE.get(name)
        case 2:
            return NAMED.get(chunks[0])
        case 3 if chunks[0] == "peer" and ADDRESS.fullmatch(chunks[1]):
            return _OF_PEER.get(chunks[2])
    return None


def document_in(documents: Mapping[str, object], name: str, kind: type[K]) -> K:
    """Return one of the documents of a gateway, decoded as plain JSON.

    Args:
        documents: By the end of their keys.
        name: The end of its key.
        kind: Its struct, or a dictionary of them. One that is absent, or that this version cannot
            read, is empty.
    """
    try:
        return msgspec.convert(documents.get(name, {}), kind, str_keys=True)
    except msgspec.ValidationError:
        return kind()
