"""Action clients and servers of one network, on Zenoh, with and without a configuration."""

import asyncio
import json
from typing import Any

import cbor2
import pytest
import zenoh

from tests.node.fleet import Goto, channel, config, plain_client, router, run_on_zenoh, settle
from tests.runtime.loop_checks import run
from zacoustic import (
    CallTimeoutError,
    DeliveryError,
    GoalStatus,
    LinkClosedError,
    LocalError,
    Node,
    ServerGoalHandle,
)

RAW = (bytes, bytes, bytes)
Handle = ServerGoalHandle[Goto.Goal, Goto.Feedback, Goto.Result]


async def pursue(handle: Handle) -> Goto.Result:
    """Go there, or wait for a cancel where it is deep."""
    handle.publish_feedback(Goto.Feedback(left=handle.request.depth))
    if handle.request.depth > 100:
        await handle.cancel_requested()
        handle.canceled()
    else:
        handle.succeed()
    return Goto.Result(depth=handle.request.depth)


@pytest.mark.parametrize("configured", [True, False])
def test_goals_of_one_local_network(configured: bool) -> None:
    async def main() -> None:
        with router() as (endpoint, _):
            async with (
                Node("shore", config=config() if configured else None, connect=endpoint) as shore,
                Node("auv1", config=config(2) if configured else None, connect=endpoint) as auv,
            ):
                server = auv.create_action_server(
                    Goto, "auv1/goto", pursue, goal_callback=lambda goal: goal.depth < 1000
                )
                await settle(auv)
                client = shore.create_action_client(Goto, "auv1/goto")
                heard: asyncio.Queue[Goto.Feedback] = asyncio.Queue()
                handle = await client.send_goal(
                    Goto.Goal(depth=7.0), feedback_callback=heard.put_nowait
                )
                assert handle.accepted
                result = await handle.result()
                assert (result.status, result.result) == (
                    GoalStatus.SUCCEEDED,
                    Goto.Result(depth=7.0),
                )
                rejected = await client.send_goal(Goto.Goal(depth=5000.0))
                assert not rejected.accepted
                deep = await client.send_goal(
                    Goto.Goal(depth=500.0), feedback_callback=heard.put_nowait
                )
                while (await heard.get()).left != 500.0:
                    pass
                assert await deep.cancel()
                assert (await deep.result()).status is GoalStatus.CANCELED
                with pytest.raises(LocalError):
                    await deep.cancel()
                server.close()
                with pytest.raises(DeliveryError):
                    await client.send_goal(Goto.Goal(depth=5.0))
                assert client.recovered() == []

    run_on_zenoh(main())


def test_nobody_who_serves_nobody_who_answers_and_a_node_that_closes() -> None:
    async def main() -> None:
        with router() as (endpoint, session):
            async with Node("auv1", config=config(2), connect=endpoint) as auv:
                async with Node("shore", config=config(), connect=endpoint) as shore:
                    client = shore.create_action_client(RAW, "auv1/raw")
                    with pytest.raises(DeliveryError, match="nobody serves it"):
                        await client.send_goal(b"x")
                    loop, held = asyncio.get_running_loop(), asyncio.Queue[zenoh.Query]()
                    mute = session.declare_queryable(
                        "auv1/raw/_action/*",
                        lambda query: loop.call_soon_threadsafe(held.put_nowait, query),
                    )
                    with pytest.raises(CallTimeoutError, match=r"no answer within 0\.5 s"):
                        await client.send_goal(b"x", timeout_s=0.5)
                    for asked in ("send_goal", "cancel_goal"):  # it may run: it is to end
                        query = await held.get()
                        assert str(query.key_expr) == f"auv1/raw/_action/{asked}"
                        query.drop()  # type: ignore[no-untyped-call]
                    mute.undeclare()  # type: ignore[no-untyped-call]

                    async def wait(handle: ServerGoalHandle[bytes, bytes, bytes]) -> None:
                        await handle.cancel_requested()

                    auv.create_action_server(RAW, "auv1/raw", wait)
                    await settle(auv)
                    handle = await client.send_goal(b"x")
                    waiting = asyncio.create_task(handle.result())
                    await asyncio.sleep(0)
                with pytest.raises(LinkClosedError):
                    await waiting

    run_on_zenoh(main())


@pytest.mark.parametrize("mode", ["link", "zenoh"])
def test_a_result_that_cannot_be_sent_aborts_the_goal(mode: str) -> None:
    async def badly(handle: Handle) -> Goto.Result:
        handle.succeed()
        return Goto.Result(depth="deep")  # type: ignore[arg-type]

    async def scene(shore: Node, auv: Node) -> None:
        auv.create_action_server(Goto, "auv1/goto", badly)
        if mode == "zenoh":
            await settle(auv)
        handle = await shore.create_action_client(Goto, "auv1/goto").send_goal(Goto.Goal(depth=7.0))
        found = await handle.result()
        assert (found.status, found.result) == (GoalStatus.ABORTED, None)

    async def on_zenoh() -> None:
        with router() as (endpoint, _):
            async with (
                Node("shore", config=config(), connect=endpoint) as shore,
                Node("auv1", config=config(2), connect=endpoint) as auv,
            ):
                await scene(shore, auv)

    async def on_link() -> None:
        with channel() as medium:
            async with (
                Node("shore", config=config(), link=medium.link(1)) as shore,
                Node("auv1", config=config(), link=medium.link(2)) as auv,
            ):
                await scene(shore, auv)

    if mode == "zenoh":
        run_on_zenoh(on_zenoh())
    else:
        run(on_link())


def test_plain_programs_speak_json_or_cbor_with_a_server() -> None:
    async def main() -> None:
        with router() as (endpoint, _):
            async with (
                Node("auv1", config=config(2), connect=endpoint) as auv,
                plain_client(endpoint) as session,
            ):
                auv.create_action_server(Goto, "auv1/goto", pursue)
                await settle(auv)

                def ask(what: str, said: dict[str, Any], *, as_json: bool = True) -> Any:
                    payload = json.dumps(said).encode() if as_json else cbor2.dumps(said)
                    encoding = "application/json" if as_json else "application/cbor"
                    (reply,) = session.get(
                        f"auv1/goto/_action/{what}", payload=payload, encoding=encoding, timeout=10
                    )
                    if reply.ok is None:
                        assert reply.err is not None
                        return reply.err.payload.to_string()
                    return cbor2.loads(reply.ok.payload.to_bytes())

                goal_id = "00112233-4455-6677-8899-aabbccddeeff"
                asked = {"goal_id": goal_id, "goal": {"depth": 5.0}}
                for _ in range(2):  # twice the same goal is one goal
                    answer = await asyncio.to_thread(ask, "send_goal", asked)
                    assert answer == {"accepted": True, "failure": None, "text": ""}
                raw_id = bytes.fromhex(goal_id.replace("-", ""))
                ended = await asyncio.to_thread(
                    lambda: ask("get_result", {"goal_id": raw_id}, as_json=False)
                )
                assert ended == {"status": "succeeded", "result": {"depth": 5.0}, "text": ""}
                late = await asyncio.to_thread(ask, "cancel_goal", {"goal_id": goal_id})
                assert (late["accepted"], late["text"]) == (False, "the goal is over")
                for what, said, text in (
                    ("get_result", {"goal_id": "ab" * 16}, f"no goal {'ab' * 16} is known"),
                    ("get_result", {"goal_id": "ab"}, "goal_id is 'ab'; allowed: 16 bytes"),
                    ("get_result", {}, "goal_id is None; allowed"),
                    ("send_goal", {"goal_id": "cd" * 16}, "goal is missing; allowed: a value of"),
                    (
                        "send_goal",
                        {"goal_id": "cd" * 16, "goal": {"depth": "x"}},
                        "BAD_REQUEST",
                    ),
                ):
                    assert text in await asyncio.to_thread(ask, what, said)

    run_on_zenoh(main())
