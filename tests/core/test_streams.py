"""Stream table: a digest changes with everything that changes meaning, and with nothing else."""

import itertools
from typing import Any

import msgspec
import pytest

from zacoustic.core.base.qos import Priority, Qos, Stamp
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import ConfigError, UnknownStreamError

NODES = {1: "shore", 2: "auv1"}
DEPTH = FieldSpec(name="depth", type="float32", range=(0, 1000), step=0.1)
TYPE = TypeSpec(name="Nav", fields=(DEPTH, FieldSpec(name="mode", type="enum", values=("a", "b"))))
VALUES = (Wildcard(name="v", values=("p", "q")), Wildcard(name="w", values=("r",)))
TOPIC = TopicSpec(stream_id=10, name="nav/{node}/{w}/{v}", type_name="Nav", wildcards=VALUES)
SERVICE = ServiceSpec(stream_id=20, name="arm", server=2, request_type="Nav", response_type="Nav")


def digest(spec: StreamSpec, type_spec: TypeSpec = TYPE, nodes: dict[int, str] = NODES) -> bytes:
    other = TypeSpec(name="Other", fields=(DEPTH,))
    return Stream(spec, TypeTable([type_spec, other]), nodes).digest


def with_field(**changes: Any) -> TypeSpec:
    fields = (msgspec.structs.replace(DEPTH, **changes), TYPE.fields[1])
    return msgspec.structs.replace(TYPE, fields=fields)


@pytest.mark.parametrize(
    "changes",
    [
        {"stream_id": 11},
        {"name": "navi/{node}/{w}/{v}"},
        {"name": "nav/{node}/{v}/{w}"},
        {"type_name": None},
        {"type_name": "Other"},
        {"publishers": (2,)},
        {"publishers": ()},
        {"subscribers": (1,)},
        {"wildcards": (Wildcard(name="v", values=("q", "p")), VALUES[1])},
        {"wildcards": (Wildcard(name="v", values=("p", "q", "z")), VALUES[1])},
        {"encoding": "application/json"},
        {"qos": Qos(stamp=Stamp.AGE)},
    ],
)
def test_topic_digest_changes_with(changes: dict[str, Any]) -> None:
    assert digest(msgspec.structs.replace(TOPIC, **changes)) != digest(TOPIC)


@pytest.mark.parametrize(
    "changes",
    [
        {"stream_id": 21},
        {"name": "disarm"},
        {"server": 1},
        {"request_type": None},
        {"response_type": None},
        {"response_type": "Other"},
        {"encoding": "application/json"},
    ],
)
def test_service_digest_changes_with(changes: dict[str, Any]) -> None:
    assert digest(msgspec.structs.replace(SERVICE, **changes)) != digest(SERVICE)


@pytest.mark.parametrize(
    "type_spec",
    [
        with_field(name="deep"),
        with_field(type="float64"),
        with_field(range=(0, 1001)),
        with_field(step=0.2),
        with_field(step=None),
        with_field(optional=True),
        with_field(length=3),
        with_field(max_length=3),
        with_field(wraps=True),
        msgspec.structs.replace(TYPE, fields=TYPE.fields[::-1]),
        msgspec.structs.replace(TYPE, fields=TYPE.fields[:1]),
        msgspec.structs.replace(
            TYPE, fields=(DEPTH, FieldSpec(name="mode", type="enum", values=("b", "a")))
        ),
    ],
)
def test_digests_change_with_what_a_type_says_of_its_bytes(type_spec: TypeSpec) -> None:
    assert digest(TOPIC, type_spec) != digest(TOPIC)
    assert digest(SERVICE, type_spec) != digest(SERVICE)


@pytest.mark.parametrize("type_spec", [with_field(unit="m"), with_field(default=3.0)])
def test_digests_do_not_change_with_what_is_for_people_and_senders(type_spec: TypeSpec) -> None:
    assert digest(TOPIC, type_spec) == digest(TOPIC)


@pytest.mark.parametrize(
    "qos",
    [
        Qos(priority=Priority.REAL_TIME),
        Qos(depth=9),
        Qos(lifespan_s=3),
        Qos(min_interval_s=3),
        Qos(linger_s=3),
    ],
)
def test_digests_do_not_change_with_when_something_is_sent(qos: Qos) -> None:
    assert digest(msgspec.structs.replace(TOPIC, qos=qos)) == digest(TOPIC)
    assert digest(msgspec.structs.replace(SERVICE, qos=qos)) == digest(SERVICE)


def test_a_time_is_the_same_whether_it_is_written_as_a_whole_number_or_not() -> None:
    """A program says 60, a configuration is read as 60.0."""
    whole = msgspec.structs.replace(SERVICE, timeout_s=60)
    assert digest(whole) == digest(msgspec.structs.replace(SERVICE, timeout_s=60.0))
    action = ActionSpec(stream_id=30, name="goto", server=2, timeout_s=60, result_timeout_s=600)
    floats = msgspec.structs.replace(action, timeout_s=60.0, result_timeout_s=600.0)
    assert digest(action) == digest(floats)


def test_digests_do_not_change_with_the_order_in_which_things_are_listed() -> None:
    for addresses in itertools.permutations((1, 2, 3)):
        spec = msgspec.structs.replace(TOPIC, publishers=addresses, subscribers=addresses)
        expected = msgspec.structs.replace(TOPIC, publishers=(1, 2, 3), subscribers=(1, 2, 3))
        assert digest(spec) == digest(expected)
    assert digest(msgspec.structs.replace(TOPIC, wildcards=VALUES[::-1])) == digest(TOPIC)
    assert digest(TOPIC, nodes={2: "auv1", 1: "shore"}) == digest(TOPIC)


def test_list_of_nodes_counts_for_streams_named_by_node_and_for_the_table() -> None:
    renamed = {1: "shore", 2: "auv2"}
    plain = TopicSpec(stream_id=1, name="plain")
    assert digest(TOPIC, nodes=renamed) != digest(TOPIC)
    assert digest(plain, nodes=renamed) == digest(plain)
    assert StreamTable([plain], nodes=renamed).digest != StreamTable([plain], nodes=NODES).digest


def test_table_digest_is_independent_of_the_order_of_declaration() -> None:
    specs = [TopicSpec(stream_id=number, name=f"t{number}") for number in (9, 3, 5)]
    digests = {StreamTable(order, nodes=NODES).digest for order in itertools.permutations(specs)}
    assert len(digests) == 1
    table = StreamTable(specs[:2], nodes=NODES)
    before = table.digest
    table.declare(specs[2])
    assert before != table.digest
    assert {table.digest} == digests
    assert [stream.stream_id for stream in table] == [3, 5, 9]


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (TopicSpec(stream_id=0, name="a"), "id: 0; allowed: 1..175"),
        (TopicSpec(stream_id=176, name="a"), "id: 176; allowed: 1..175"),
        (TopicSpec(stream_id=10, name="a"), "id: 10 is taken by first"),
        (TopicSpec(stream_id=11, name="first"), 'name: "first" is taken by stream 10'),
        (TopicSpec(stream_id=11, name="a", type_name="No"), 'type "No" is not known'),
        (ServiceSpec(stream_id=11, name="a", server=0), "server: 0; allowed: the address"),
        (ServiceSpec(stream_id=11, name="a", server=255), "server: 255; allowed: the address"),
        (ServiceSpec(stream_id=11, name="a", server=1, timeout_s=0), "timeout_s: 0"),
        (ServiceSpec(stream_id=11, name="a/{node}", server=1), "allowed in topics only"),
    ],
)
def test_wrong_spec_is_refused_with_its_reason(spec: StreamSpec, message: str) -> None:
    table = StreamTable([TopicSpec(stream_id=10, name="first")])
    with pytest.raises(ConfigError, match=message):
        table.declare(spec)
    assert len(table) == 1


def test_streams_are_found_by_id_name_and_key() -> None:
    table = StreamTable([TOPIC, SERVICE], types=TypeTable([TYPE]), nodes=NODES)
    assert table.by_id(10).name == TOPIC.name
    assert table.by_name("arm").stream_id == 20
    assert table.find("arm", 1) == (table.by_id(20), ())
    assert table.find("nav/auv1/r/q", 2) == (table.by_id(10), (0, 1))
    assert table.find("nav/auv1/r/q", 1) is None
    assert table.find(TOPIC.name, 1) is None
    with pytest.raises(UnknownStreamError, match="no stream has id 11; there are: 10, 20"):
        table.by_id(11)
    with pytest.raises(UnknownStreamError, match='no stream is called "x"; there are: arm, nav'):
        table.by_name("x")
