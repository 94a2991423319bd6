"""What a stream cannot be where rmw_desert is on the other side."""

from typing import Any

import pytest

from tests.core.rmw_desert.vehicle import TYPES, table
from zacoustic.core.base.qos import Forward, Qos, Reliability, Stamp
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import ConfigError

STRING = "std_msgs/msg/String"


def topic(**settings: Any) -> TopicSpec:
    plain: dict[str, Any] = {"stream_id": 7, "name": "note", "type_name": STRING}
    return TopicSpec(**(plain | settings))


REFUSED: tuple[tuple[StreamSpec, str], ...] = (
    (topic(stream_id=0), r"id: 0; allowed: 1\.\.255"),
    (topic(stream_id=256), r"id: 256; allowed: 1\.\.255"),
    (topic(codec="packed"), 'codec: "packed" with wire: "rmw_desert"; allowed: none'),
    (topic(codec="dense"), 'codec: "dense" with wire: "rmw_desert"; allowed: none'),
    (topic(type_name=None), "type: is missing with wire"),
    (topic(qos=Qos(reliability=Reliability.RELIABLE)), 'reliability: "reliable" .* best_effort'),
    (topic(qos=Qos(stamp=Stamp.AGE)), 'stamp: "age" .* allowed: none'),
    (topic(qos=Qos(forward=Forward.ON_DEMAND)), 'forward: "on_demand" .* allowed: always'),
    (topic(name="fleet/{node}/note"), "has a placeholder"),
    (
        topic(name="a/{b}", wildcards=(Wildcard(name="b", values=("c",)),)),
        "has a placeholder",
    ),
    (topic(journal=True), "journal: with wire"),
    (topic(max_bytes=100), "max_bytes: with wire"),
    (
        ServiceSpec(stream_id=7, name="s", server=1, response_type=STRING),
        "request: is missing with wire",
    ),
    (
        ServiceSpec(stream_id=7, name="s", server=1, request_type=STRING),
        "response: is missing with wire",
    ),
    (
        ServiceSpec(stream_id=7, name="s", server=300, request_type=STRING, response_type=STRING),
        "server: 300",
    ),
    (ActionSpec(stream_id=7, name="goto", server=1), 'action: "goto" .* topic, service'),
)


@pytest.mark.parametrize(("spec", "text"), REFUSED, ids=lambda part: str(part)[:20])
def test_what_has_no_counterpart_is_refused_by_its_key(spec: StreamSpec, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        table(spec)


@pytest.mark.parametrize(
    ("field", "text"),
    [
        (FieldSpec(name="f", type="int8", optional=True), "type: T.f is optional"),
        (FieldSpec(name="f", type="bytes", length=3, max_length=9), "type: T.f is an array of"),
    ],
)
def test_a_type_that_no_ros_message_has_is_refused(field: FieldSpec, text: str) -> None:
    types = TypeTable([TypeSpec(name="T", fields=(field,))])
    spec = topic(type_name="T")
    with pytest.raises(ConfigError, match=text):
        StreamTable([spec], types=types, wire=WireProfile.RMW_DESERT)
    assert len(StreamTable([spec], types=types)) == 1


def test_ids_above_those_of_the_native_wire_are_there() -> None:
    assert [each.stream_id for each in table(topic(stream_id=255))] == [255]
    with pytest.raises(ConfigError, match=r"id: 255; allowed: 1\.\.175"):
        StreamTable([topic(stream_id=255)], types=TYPES)
