"""Services of ROS 2 across two gateways: one call, one execution, one answer."""

import time
from typing import Any

from tests.gateway.networks import fence, get
from tests.gateway.rosnode import Told, reply
from tests.gateway.rospair import ADD, Pair, with_pair
from zacoustic.ros.tokens import Entity


def added(asked: dict[str, Any]) -> dict[str, Any]:
    return {"sum": asked["a"] + asked["b"]}


@with_pair()
async def test_a_call_is_answered_as_clients_of_ros_expect(pair: Pair) -> None:
    assert await pair.shore.available(Entity.SERVER, "/add") is not None
    pair.auv.serve("/add", ADD, added)
    await fence(pair.auv.session)
    client = pair.shore.client("/add", ADD)
    for sequence in (1, 2):
        begun_ns = time.time_ns()
        ((value, beside),) = await client.call({"a": 2, "b": sequence})
        assert value == {"sum": 2 + sequence}
        assert beside.sequence == sequence
        assert beside.gid == client.gid
        assert begun_ns <= beside.stamp_ns <= time.time_ns()


@with_pair()
async def test_of_two_complete_servers_one_runs_and_one_answers(pair: Pair) -> None:
    ran: list[str] = []

    def run_by(name: str) -> Any:
        def answer(asked: dict[str, Any]) -> dict[str, Any]:
            ran.append(name)
            return added(asked)

        return answer

    pair.auv.serve("/add", ADD, run_by("one"))
    other = pair.node(2, "other_server")
    other.serve("/add", ADD, run_by("other"))
    for node in (pair.auv, other):
        await fence(node.session)
    client = pair.shore.client("/add", ADD)
    for number in range(5):
        assert [value for value, _ in await client.call({"a": number, "b": 0})] == [{"sum": number}]
    assert len(ran) == 5


@with_pair()
async def test_a_server_may_take_its_time(pair: Pair) -> None:
    asked = Told()

    def later(value: dict[str, Any]) -> None:
        asked.tell(value)

    pair.auv.serve("/add", ADD, later)
    await fence(pair.auv.session)
    client = pair.shore.client("/add", ADD)
    told = client.ask({"a": 20, "b": 22})
    value = await asked.next()
    assert told.empty()
    (query,) = pair.auv.held()
    reply(query, pair.auv.message(f"{ADD}_Response").write(added(value)))
    answer = await told.next()
    assert answer is not None, client.errors
    assert answer[0] == {"sum": 42}
    assert await told.next() is None


@with_pair()
async def test_a_call_without_a_server_is_an_error_reply_that_names_the_failure(
    pair: Pair,
) -> None:
    client = pair.shore.client("/add", ADD)
    assert await client.call({"a": 1, "b": 1}) == []  # rmw_zenoh passes over errors
    key = str(pair.shore.key("/add", ADD))
    request = pair.shore.message(f"{ADD}_Request").write({"a": 1, "b": 1})
    (text,) = (await get(pair.shore.session, key, request)).errors
    assert text.startswith(f"{key}: NO_SERVER: ")
    (text,) = (await get(pair.shore.session, key, b"nonsense")).errors
    assert text.startswith(f"{key}: BAD_REQUEST: ")


@with_pair()
async def test_an_answer_that_is_none_is_an_error(pair: Pair) -> None:
    pair.auv.session.declare_queryable(
        str(pair.auv.key("/add", ADD)),
        lambda query: query.reply(query.key_expr, b"nonsense"),
        complete=True,
    )
    await fence(pair.auv.session)
    key = str(pair.shore.key("/add", ADD))
    request = pair.shore.message(f"{ADD}_Request").write({"a": 1, "b": 1})
    (text,) = (await get(pair.shore.session, key, request)).errors
    assert text.startswith(f"{key}: HANDLER: ")


@with_pair()
async def test_looking_around_runs_nothing(pair: Pair) -> None:
    ran: list[object] = []

    def answer(asked: dict[str, Any]) -> dict[str, Any]:
        ran.append(asked)
        return added(asked)

    pair.auv.serve("/add", ADD, answer)
    await fence(pair.auv.session)
    replies = await get(pair.shore.session, "7/add/**")
    assert not replies.good
    assert all("a wildcard calls no service" in text for text in replies.errors)
    assert ran == []
