"""The rows of requests to a gateway: what is asked is what is read, and what is wrong is named."""

from typing import Any

import pytest

from zacoustic.core.base.qos import Priority
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.wire.routing import RoutingKind, RoutingRequest
from zacoustic.zenoh.requests.cancel import CANCEL, CancelAsked
from zacoustic.zenoh.requests.commands import SILENCE, STREAM, row_of
from zacoustic.zenoh.requests.key import KEY, KeyAsked
from zacoustic.zenoh.requests.ping import PING, PingAsked
from zacoustic.zenoh.requests.report import REPORT
from zacoustic.zenoh.requests.request import Request
from zacoustic.zenoh.requests.routing import ROUTING
from zacoustic.zenoh.requests.table import REQUESTS

OFF = RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=11, on=False)
SLOW = RemoteCommand(
    kind=CommandKind.OVERRIDE, stream_id=11, min_interval_s=0.0, priority=Priority.BACKGROUND
)
PATH = RoutingRequest(
    kind=RoutingKind.SET, route_id=1, revision=5, number=31, path=(1, 4, 3), via=(2,)
)


def parameters_of(text: str) -> dict[str, str]:
    return dict(word.split("=", 1) for word in text.split(";") if word)


@pytest.mark.parametrize(
    ("request_", "question", "key", "text"),
    [
        (PING, PingAsked(), "ping", "within_s=30"),
        (PING, PingAsked(status=True), "ping", "status=true;within_s=30"),
        (KEY, KeyAsked(source=5), "key", "source=5;within_s=30"),
        (SILENCE, RemoteCommand(), "silence", "within_s=30"),
        (
            SILENCE,
            RemoteCommand(kind=CommandKind.SILENCE, for_s=1800.0),
            "silence",
            "command=begin;for_s=1800;within_s=30",
        ),
        (
            SILENCE,
            RemoteCommand(kind=CommandKind.RESUME),
            "silence",
            "command=resume;within_s=30",
        ),
        (STREAM, RemoteCommand(stream_id=11), "stream/11", "within_s=30"),
        (STREAM, OFF, "stream/11", "on=false;within_s=30"),
        (STREAM, SLOW, "stream/11", "min_interval_s=0;priority=background;within_s=30"),
        (
            STREAM,
            RemoteCommand(kind=CommandKind.RESET, stream_id=11),
            "stream/11",
            "reset=true;within_s=30",
        ),
        (
            ROUTING,
            RoutingRequest(kind=RoutingKind.HEARD, run=7, via=(2, 3)),
            "routing",
            "do=heard;run=7;after=0;via=2,3;within_s=30",
        ),
        (
            ROUTING,
            PATH,
            "routing",
            "do=set;route=1;revision=5;number=31;path=1,4,3;via=2;within_s=30",
        ),
        (CANCEL, CancelAsked(id=7), "objects/cancel", "id=7"),
        (CANCEL, CancelAsked(source=1, transfer=12), "objects/cancel", "source=1;transfer=12"),
    ],
)
def test_what_is_asked_is_what_is_read(
    request_: Request[Any, Any], question: object, key: str, text: str
) -> None:
    assert request_ in REQUESTS
    assert request_.selector(3, question, 30.0) == (f"@acoustic/3/{key}", text)
    target = request_.target(f"@acoustic/3/{key}", parameters_of(text))
    assert target is not None
    assert target[0] == 3
    read, within_s = request_.read(key, target[1], parameters_of(text) | {"_time": "now"})
    assert read == question
    assert within_s == (30.0 if request_.most_s else 0.0)
    if isinstance(question, RemoteCommand):
        assert row_of(question) is request_


@pytest.mark.parametrize(
    "key",
    ["**", "*/*", "*/stream/*", "3*/silence", "$*/objects/cancel", "**/cancel", "3/silence/x"],
)
def test_a_query_that_browses_is_no_request(key: str) -> None:
    assert [each for each in REQUESTS if each.target(f"@acoustic/{key}", ())] == []


def test_a_wildcard_asks_each_gateway_for_its_own_node_where_that_makes_sense() -> None:
    asked = {
        each.subject
        for each in REQUESTS
        if each.target(f"@acoustic/*/{each.subject.format(stream_id=11)}", ())
    }
    assert asked == {"silence", "stream/{stream_id}", "objects/cancel"}
    assert ROUTING.target("@acoustic/*/routing", ("do",)) == (None, {})


@pytest.mark.parametrize(
    ("request_", "text", "error"),
    [
        (PING, "status=yes", "status is yes; allowed: true, false"),
        (PING, "within_s=0", "within_s is 0; allowed: seconds above 0, at most 600"),
        (PING, "count=3", "count is no parameter of KEY; allowed: status, within_s"),
        (KEY, "", "source is missing; allowed: 1..254"),
        (KEY, "source=255", "source is 255; allowed: 1..254"),
        (SILENCE, "for_s=3", "for_s is 3; allowed: with command=begin, seconds above 0"),
        (ROUTING, "run=7", "do is missing; allowed: "),
        (ROUTING, "do=fly", "do is fly; allowed: "),
        (ROUTING, "do=heard;run=x", "run is x; allowed: whole numbers"),
        (ROUTING, "do=heard;run=7;via=2,x", "via is 2,x; allowed: whole numbers"),
        (ROUTING, "do=ask;run=7", "run is no parameter of do=ask; allowed: route, via, within_s"),
        (CANCEL, "source=1", "allowed: id, or source and transfer; numbers"),
        (CANCEL, "id=x", "id is x; allowed: id, or source and transfer; numbers"),
    ],
)
def test_what_is_wrong_is_named_with_what_is_allowed(
    request_: Request[Any, Any], text: str, error: str
) -> None:
    with pytest.raises(ValueError, match="allowed") as raised:
        request_.read("KEY", {}, parameters_of(text))
    assert error in str(raised.value)


def test_documents_of_the_report_are_named_and_found_by_one_row() -> None:
    assert REPORT.key(3) == "@acoustic/3/**"
    assert REPORT.key(None, "relay") == "@acoustic/*/relay"
    for document in ("link", "link/uhf", "peer/2/range"):
        assert REPORT.place(REPORT.key(254, document)) == (254, document)
    for key in ("@acoustic/*/link", "@acoustic/3", "@acoustic/x/link", "acoustic/3/link"):
        assert REPORT.place(key) is None
