"""QoS: what a stream may ask for."""

from typing import Any

import pytest

from zacoustic.core.base.qos import PATIENCE_NS, PRIORITY_NAMES, Override, Priority, Qos


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"depth": 0}, "depth is 0; allowed: a number, 1..65535"),
        ({"depth": 65536}, "depth is 65536; allowed: a number, 1..65535"),
        ({"lifespan_s": 0}, "lifespan_s is 0; allowed: seconds, above 0"),
        ({"lifespan_s": float("inf")}, "lifespan_s is inf; allowed: seconds, above 0"),
        ({"lifespan_s": float("nan")}, "lifespan_s is nan; allowed: seconds, above 0"),
        ({"min_interval_s": -1}, "min_interval_s is -1; allowed: seconds, 0 or more"),
        ({"linger_s": float("nan")}, "linger_s is nan; allowed: seconds, 0 or more"),
    ],
)
def test_value_outside_its_range_is_named(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Qos(**settings)


def test_patience_grows_from_priority_to_priority() -> None:
    patience = [PATIENCE_NS[each] for each in Priority if each is not Priority.REAL_TIME]
    assert patience == sorted(set(patience))
    assert len(PRIORITY_NAMES) == 7


def test_real_time_never_lingers() -> None:
    assert Qos(priority=Priority.REAL_TIME, linger_s=5).linger_ns == 0
    assert Qos(linger_s=5).linger_ns == 5_000_000_000


def test_an_order_may_make_a_topic_rarer_than_its_deadline() -> None:
    overridden = Override(min_interval_s=60.0).over(Qos(deadline_s=30.0))
    assert overridden.min_interval_s == 60.0
