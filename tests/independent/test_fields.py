"""The `fields` of every vector and every conversation, compared one by one."""

from typing import Any

import pytest

from tests.independent import (
    blocks,
    compose,
    dense,
    describe,
    envelope,
    fields,
    fleet,
    frame,
    sealed,
)
from tests.independent.fleet import TABLES
from tests.independent.record import Acknowledgement, Call, Goal, Sample, Way
from tests.independent.table import Table

NATIVE = [one for one in fleet.load("wire_native.json") if "source" in one]
BY_NAME = {one["name"]: one for one in NATIVE}
SEALED = fleet.load("wire_sealed.json")
CONVERSATIONS = [
    "call", "contact", "dense", "goal", "object", "reliable", "reliable_sealed", "sealed", "tables",
]  # fmt: skip


def opened(one: dict[str, Any]) -> bytes:
    """Return the records of a frame as the vectors have it."""
    data = bytes.fromhex(one["hex"])
    if "link" not in one:
        return data
    link = one["link"]
    capabilities = envelope.Capabilities(link["addressed"], link["checked"], link["framed"])
    addresses = (one["destination"], one["source"])
    found = envelope.unwrap(data, capabilities, addresses=addresses)
    assert (found.destination, found.source) == addresses
    return found.records


class _Readers:
    """Readers of the dense blocks of each source, by one table."""

    def __init__(self, own: Table) -> None:
        self._table = own
        self._readers: dict[int, blocks.Reader] = {}

    def fields(self, placed: frame.Placed, way: Way) -> dict[str, Any]:
        if not isinstance(placed.item, dense.Block):
            return fields.of(placed, way)
        reader = self._readers.setdefault(way.source, blocks.of_table(self._table, way.source))
        return fields.of_block(placed.item, reader)


def _found(one: dict[str, Any], readers: _Readers) -> list[dict[str, Any]]:
    """Return the fields of a vector, behind those that stand before it."""
    for name in one.get("after", ()):
        _found(BY_NAME[name], readers)
    way = Way(TABLES[one["table"]], one["source"], one["destination"])
    return [readers.fields(placed, way) for placed in frame.read(opened(one), way).placed]


@pytest.mark.parametrize("one", NATIVE, ids=lambda one: one["name"])
def test_fields(one: dict[str, Any]) -> None:
    assert _found(one, _Readers(TABLES[one["table"]])) == one["fields"]


@pytest.mark.parametrize("one", SEALED, ids=lambda one: one["name"])
def test_fields_of_sealed_frames(one: dict[str, Any]) -> None:
    key = sealed.FleetKey.of_plain(one["key"])
    way = sealed.Way(one["source"], one["destination"], one["port"])
    data = bytes.fromhex(one["frame"])
    head, _ = sealed.read_head(data)
    assert head.strong == one["strong"]
    records = sealed.open_frame(
        data,
        way,
        key,
        life=one["life"],
        counter=one["counter"],
        digest=bytes.fromhex(one["digest"]),
        encrypted=one["mode"] == "encrypt",
    )
    assert records.hex() == one["records"]
    inside = Way(TABLES["base"], one["source"], one["destination"])
    whole = frame.read(records, inside, life=one["life"], weak=not head.strong)
    found = [fields.of(placed, inside) for placed in whole.placed]
    if "refused" in one["fields"][-1]:
        assert found == [{"unread": one["records"]}]
    else:
        assert found == one["fields"]


@pytest.mark.parametrize("name", CONVERSATIONS)
def test_fields_of_conversations(name: str) -> None:
    """Every frame, whether it is heard or lost, sealed ones as the other node opens them."""
    talk = fleet.load(f"conversations/{name}.json")
    tables = {int(node): TABLES[table] for node, table in talk["tables"].items()}
    receivers = {}
    if "key" in talk:
        key = sealed.FleetKey.of_plain(talk["key"])
        for node, table in tables.items():
            receivers[node] = sealed.Receiver(node, key, describe.table_digest(table))
    frames = [line for line in talk["lines"] if "sends" in line]
    readers = _Readers(tables[1])
    assert frames
    for sent in frames:
        records, life, weak = bytes.fromhex(sent["hex"]), None, False
        if receivers:
            whole = receivers[3 - sent["node"]].open(records, sent["node"], sent["to"])
            seal = sent["seal"]
            assert whole.records.hex() == sent["records"]
            assert whole.digest.hex() == (seal["table"] or "00000000")
            assert (whole.life, whole.counter) == (seal["life"], seal["counter"])
            assert whole.strong == seal["strong"]
            records, life, weak = whole.records, whole.life, not whole.strong
        way = Way(tables[sent["node"]], sent["node"], sent["to"])
        found = frame.read(records, way, life=life, weak=weak)
        assert [readers.fields(placed, way) for placed in found.placed] == sent["fields"]


def test_what_the_fields_say_can_be_written_again() -> None:
    """The bytes of `payload` are those of `value`: codecs have one form only."""
    for one in NATIVE:
        if one["name"] in fleet.READ_ONLY:
            continue
        way = Way(TABLES[one["table"]], one["source"], one["destination"])
        for placed in frame.read(opened(one), way).placed:
            if isinstance(placed.item, Sample | Acknowledgement | Call | Goal):
                assert placed.data.endswith(compose.write(placed.item, way.table))
