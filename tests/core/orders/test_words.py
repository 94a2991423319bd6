"""What an order says: what is allowed, and both ways over the wire."""

import pytest

from zacoustic.core.base.qos import Priority
from zacoustic.core.streams.commands import (
    ORDERS_STREAM_ID,
    REQUEST_TYPE,
    RESPONSE_TYPE,
    Order,
    OrderKind,
    OrderState,
    order_types,
)
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.payload import CborCodec

REQUESTS = CborCodec(order_types().by_name(REQUEST_TYPE))
RESPONSES = CborCodec(order_types().by_name(RESPONSE_TYPE))


@pytest.mark.parametrize(
    "order",
    [
        Order(),
        Order(stream_id=175),
        Order(kind=OrderKind.SILENCE),
        Order(kind=OrderKind.SILENCE, for_s=0.1),
        Order(kind=OrderKind.SILENCE, for_s=366 * 86400.0),
        Order(kind=OrderKind.RESUME),
        Order(kind=OrderKind.RESET, stream_id=1),
        Order(kind=OrderKind.TUNE, stream_id=1, on=False),
        Order(kind=OrderKind.TUNE, stream_id=9, min_interval_s=86400.0),
        *(Order(kind=OrderKind.TUNE, stream_id=9, on=True, priority=each) for each in Priority),
    ],
)
def test_order_crosses_as_it_is(order: Order) -> None:
    payload = REQUESTS.encode(order.to_wire(65535))
    assert Order.from_wire(REQUESTS.decode(payload)) == (65535, order)
    assert len(payload) <= 14


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({"for_s": 5.0}, "for_s is 5; allowed: with silence only"),
        ({"kind": OrderKind.SILENCE, "for_s": 0.0}, "for_s is 0; allowed: 0.1..31622400"),
        ({"kind": OrderKind.SILENCE, "for_s": float("nan")}, "for_s is nan; allowed: 0.1"),
        ({"kind": OrderKind.SILENCE, "for_s": 4e7}, "for_s is 4e.07; allowed: 0.1..31622400"),
        ({"kind": OrderKind.SILENCE, "stream_id": 1}, "stream_id is 1; allowed: not with silence"),
        ({"kind": OrderKind.RESUME, "stream_id": 1}, "stream_id is 1; allowed: not with resume"),
        ({"kind": OrderKind.TUNE, "on": True}, "stream_id is missing; allowed: a topic to tune"),
        ({"kind": OrderKind.RESET}, "stream_id is missing; allowed: a topic to reset"),
        ({"stream_id": 176}, "stream_id is 176; allowed: 1..175"),
        ({"kind": OrderKind.TUNE, "stream_id": 1}, "allowed: at least one"),
        ({"stream_id": 1, "on": True}, "allowed: with tune only"),
        (
            {"kind": OrderKind.TUNE, "stream_id": 1, "min_interval_s": -1.0},
            "min_interval_s is -1; allowed: 0..86400",
        ),
    ],
)
def test_order_that_makes_no_sense_is_refused(fields: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        Order(**fields)  # type: ignore[arg-type]


def test_state_crosses_and_ages() -> None:
    state = OrderState(
        silent=True,
        ordered=True,
        left_s=120.0,
        on=False,
        min_interval_s=10.0,
        priority=Priority.BACKGROUND,
    )
    found = RESPONSES.decode(RESPONSES.encode(state.to_wire()))
    assert OrderState.from_wire(found, 0.0) == state
    assert OrderState.from_wire(found, 20.0).left_s == 100.0
    over = OrderState.from_wire(found, 200.0)
    assert (over.silent, over.ordered, over.left_s) == (False, False, None)
    assert over.on is False


def test_what_is_beyond_the_wire_is_cut() -> None:
    state = OrderState(silent=True, ordered=False, left_s=1e12, on=True, min_interval_s=1e9)
    found = OrderState.from_wire(RESPONSES.decode(RESPONSES.encode(state.to_wire())), 0.0)
    assert found.left_s == 366 * 86400.0
    assert found.min_interval_s == 86400.0


def test_orders_are_in_every_table_and_in_no_digest() -> None:
    table = StreamTable([TopicSpec(stream_id=1, name="a")])
    assert table.by_id(ORDERS_STREAM_ID).is_built_in
    assert [stream.stream_id for stream in table] == [1]
    assert len(table) == 1
    assert table.find("orders", 1) is None
    before = table.digest
    own = table.declare(TopicSpec(stream_id=ORDERS_STREAM_ID, name="orders"))
    assert table.by_id(ORDERS_STREAM_ID) is own
    assert table.digest != before
