"""The id that a command returns is the id in its answer, whichever link carries the answer."""

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import pytest

from tests.virtual.test_members import MemberFleet
from tests.virtual.twolinks import ARM, BESIDE, FIX, LINKS, PLAN, RADIO, ROUTES, SOUND, TwoLinks
from zacoustic.core.bond.spec import Bond
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, DeliveryEnded, ResponseReceived
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.relay.route import Route
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.wire.routing import RoutingKind, RoutingRequest

BOND: Final = Bond(number=31, links=(RADIO, SOUND))
ROUTE: Final = Route(route_id=1, name="far", path=(2, 3, 1), link=SOUND)
OVER: Final[dict[str, dict[str, Any]]] = {
    "": {},
    SOUND: {},
    RADIO: {},
    BOND.name: {"bonds": (BOND,)},
    ROUTE.name: {"routes": (ROUTE,)},
    FLOOD_NAME: {"flood": Flood(link=SOUND)},
}
"""What is over the links, by the default link that makes use of it."""
ASK: Final = RemoteCommand(kind=CommandKind.ASK)
SILENCE: Final = RemoteCommand(kind=CommandKind.SILENCE, for_s=0.5)
HEARD: Final = RoutingRequest(kind=RoutingKind.HEARD, run=1)
ASKED: Final[dict[str, Callable[[Engine, int], int]]] = {
    "state": lambda engine, now: engine.commands.send(1, ASK, now),
    "silence": lambda engine, now: engine.commands.send(1, SILENCE, now),
    "status": lambda engine, now: engine.status.ask(1, now, timeout_s=300.0),
    "key": lambda engine, now: engine.keys.send(1, 2, now),
    "probes": lambda engine, now: engine.routing.send(1, HEARD, now),
    "over another": lambda engine, now: engine.routing.send(
        1, RoutingRequest(kind=RoutingKind.HEARD, run=1, via=(3,)), now
    ),
    "call by sound": lambda engine, now: engine.call(ARM, b"?", now),
    "call by radio": lambda engine, now: engine.call(ARM + BESIDE, b"?", now),
}
PUBLISHED: Final[dict[str, Callable[[Engine, int], int]]] = {
    "sample by sound": lambda engine, now: engine.publish(PLAN, b"?", now),
    "sample by radio": lambda engine, now: engine.publish(PLAN + BESIDE, b"?", now),
}


def fleet(default: str) -> TwoLinks:
    """Return three nodes on two links, whose streams name one of them, by a default link."""
    rules = TransmitRules(
        links=tuple(LinkRules(name=each) for each in LINKS),
        links_of_streams=dict.fromkeys((FIX, PLAN, ARM), SOUND) | ROUTES,
        default_link=default,
        **OVER[default],
    )
    return TwoLinks(3, build=MemberFleet(), rules=rules)


def asked(default: str) -> dict[str, Callable[[Engine, int], int]]:
    """Return what is asked: in frames of 64 bytes no key goes over other nodes."""
    left_out = "key" if default in (ROUTE.name, FLOOD_NAME) else ""
    return {name: command for name, command in ASKED.items() if name != left_out}


@pytest.mark.parametrize("default", OVER)
@pytest.mark.parametrize("knows", [True, False], ids=["known", "unknown"])
def test_every_answer_has_the_id_that_its_command_returned(default: str, *, knows: bool) -> None:
    two = fleet(default)
    if knows:
        two.acquaint()
    given: dict[str, int] = {}

    def give(name: str, command: Callable[[Engine, int], int]) -> None:
        given[name] = two.network.apply(2, command)

    for number, (name, command) in enumerate((asked(default) | PUBLISHED).items()):
        two.network.at(150.0 + 150 * number, partial(give, name, command))
    two.network.run(until_s=3000.0)
    answers = [each.call_id for each in two.told(2, ResponseReceived)]
    # A list that has the key already refuses it: that is an answer as well.
    answers += [each.call_id for each in two.told(2, CallFailed)]
    ended = [each.delivery_id for each in two.told(2, DeliveryEnded)]
    assert sorted(answers) == sorted(given[each] for each in asked(default))
    assert sorted(ended) == sorted(given[each] for each in PUBLISHED)
    assert len(set(given.values())) == len(given)


@pytest.mark.parametrize("default", OVER)
def test_what_was_asked_is_cancelled_by_its_id_and_nothing_else(default: str) -> None:
    two = fleet(default)
    given = {name: two.network.apply(2, command) for name, command in asked(default).items()}

    def cancel(engine: Engine, now: int) -> None:
        for name in given:
            if name != "status":
                engine.cancel(given[name], now)

    two.network.apply(2, cancel)
    two.network.run(until_s=700.0)
    ended: list[Any] = two.told(2, ResponseReceived) + two.told(2, CallFailed)
    assert [each.call_id for each in ended] == [given["status"]]


def test_links_give_different_ids() -> None:
    two = TwoLinks()
    ids = [two.call(2, stream_id, b"?") for stream_id in (ARM, ARM + BESIDE) for _ in range(3)]
    assert len(set(ids)) == len(ids)
