"""Action clients and action servers in direct mode, over simulated water."""

import asyncio
import logging
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.node.fleet import Goto, Nav, channel, config
from tests.runtime.loop_checks import run
from zacoustic import (
    DeliveryError,
    GoalResult,
    GoalStatus,
    LinkClosedError,
    LocalError,
    Node,
    PayloadInvalidError,
    ServerGoalHandle,
)
from zacoustic_sim.medium import SimMedium

RAW = (bytes, bytes, bytes)
Handle = ServerGoalHandle[Goto.Goal, Goto.Feedback, Goto.Result]


def two_nodes(medium: SimMedium) -> tuple[Node, Node]:
    shore = Node("shore", config=config(), link=medium.link(1))
    return shore, Node("auv1", config=config(), link=medium.link(2))


async def dive(handle: Handle) -> Goto.Result:
    """Go there at once."""
    assert handle.publish_feedback(Goto.Feedback(left=handle.request.depth))
    handle.succeed()
    return Goto.Result(depth=handle.request.depth)


async def wait_for_cancel(handle: Handle) -> Goto.Result:
    await handle.cancel_requested()
    assert handle.is_cancel_requested
    handle.canceled()
    return Goto.Result(depth=1.5)


def test_a_goal_is_accepted_and_ends_with_a_result() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                auv.create_action_server(Goto, "auv1/goto", dive)
                client = shore.create_action_client(Goto, "auv1/goto")
                handle = await client.send_goal(Goto.Goal(depth=12.0))
                assert handle.accepted
                for _ in range(2):
                    assert await handle.result(timeout_s=20) == GoalResult(
                        status=GoalStatus.SUCCEEDED, result=Goto.Result(depth=12.0)
                    )
                with pytest.raises(LocalError, match="the goal has ended"):
                    await handle.cancel()

    run(main())


def test_feedback_comes_while_the_goal_runs() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            heard: asyncio.Queue[Goto.Feedback] = asyncio.Queue()
            goes_on = asyncio.Event()

            async def report(handle: Handle) -> Goto.Result | None:
                for left in (3.0, 2.0, 1.0):
                    handle.publish_feedback(Goto.Feedback(left=left))
                    await goes_on.wait()
                    goes_on.clear()
                handle.abort(Goto.Result(depth=0.0))
                return None

            async with shore, auv:
                auv.create_action_server(Goto, "auv1/goto", report)
                client = shore.create_action_client(Goto, "auv1/goto")
                handle = await client.send_goal(
                    Goto.Goal(depth=12.0), feedback_callback=heard.put_nowait
                )
                for left in (3.0, 2.0, 1.0):
                    assert (await heard.get()).left == left
                    goes_on.set()
                result = await handle.result()
                assert (result.status, result.result) == (GoalStatus.ABORTED, Goto.Result(depth=0))

    run(main())


def test_a_goal_is_cancelled_and_its_callback_says_so() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                auv.create_action_server(Goto, "auv1/goto", wait_for_cancel)
                client = shore.create_action_client(Goto, "auv1/goto")
                handle = await client.send_goal(Goto.Goal(depth=12.0))
                assert await handle.cancel()
                result = await handle.result()
                assert result.status is GoalStatus.CANCELED
                assert result.result == Goto.Result(depth=1.5)

    run(main())


def test_goals_and_cancels_can_be_refused(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            asked: list[float] = []

            async def is_deep(handle: Handle) -> bool:
                asked.append(handle.request.depth)
                return False

            def accept(goal: Goto.Goal) -> bool:
                if goal.depth < 0:
                    raise ValueError("it is not a plane")
                return goal.depth < 100

            async with shore, auv:
                auv.create_action_server(
                    Goto, "auv1/goto", wait_for_cancel,
                    goal_callback=accept, cancel_callback=is_deep,
                )  # fmt: skip
                client = shore.create_action_client(Goto, "auv1/goto")
                too_deep = await client.send_goal(Goto.Goal(depth=500.0))
                assert (too_deep.accepted, too_deep.text) == (False, "rejected")
                with pytest.raises(DeliveryError, match="the goal was rejected"):
                    await too_deep.result()
                plane = await client.send_goal(Goto.Goal(depth=-5.0))
                assert (plane.accepted, plane.text) == (False, "it is not a plane")
                handle = await client.send_goal(Goto.Goal(depth=50.0))
                assert not await handle.cancel()
                assert asked == [50.0]
                with pytest.raises(TimeoutError):
                    await handle.result(timeout_s=0.01)

    with caplog.at_level(logging.WARNING):
        run(main())
    assert "auv1/goto: the callback of goals failed" in caplog.text


def test_what_goes_wrong_in_a_callback_aborts_the_goal(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:

                async def pursue(handle: ServerGoalHandle[bytes, bytes, bytes]) -> Any:
                    if handle.request == b"raise":
                        raise RuntimeError("a leak")
                    if handle.request == b"wrong":
                        handle.succeed()
                        return 7
                    return b"nobody has said how it ended"

                auv.create_action_server(RAW, "auv1/raw", pursue)
                client = shore.create_action_client(RAW, "auv1/raw")
                for goal, result in (
                    (b"raise", None),
                    (b"wrong", None),
                    (b"silent", b"nobody has said how it ended"),
                ):
                    handle = await client.send_goal(goal)
                    ended = await handle.result()
                    assert (ended.status, ended.result) == (GoalStatus.ABORTED, result)

    with caplog.at_level(logging.WARNING):
        run(main())
    assert "the goal failed" in caplog.text
    assert "the result cannot be sent" in caplog.text
    assert "the callback set no status" in caplog.text


def test_nobody_who_serves_is_an_error() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                client = shore.create_action_client(Goto, "auv1/goto")
                with pytest.raises(DeliveryError, match="no program serves auv1/goto"):
                    await client.send_goal(Goto.Goal(depth=1.0))

    run(main())


def test_mistakes_are_told_when_they_are_made() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                with pytest.raises(LocalError, match="auv1/arm is a service, not an action"):
                    shore.create_action_client(RAW, "auv1/arm")
                with pytest.raises(LocalError, match="auv1/goto is an action, not a topic"):
                    shore.create_publisher(Nav, "auv1/goto")
                with pytest.raises(LocalError, match="is served by node 2; this is node 1"):
                    shore.create_action_server(Goto, "auv1/goto", dive)
                with pytest.raises(LocalError, match="it cannot call itself"):
                    auv.create_action_client(Goto, "auv1/goto")
                server = auv.create_action_server(Goto, "auv1/goto", dive)
                with pytest.raises(LocalError, match="is served by this node already"):
                    auv.create_action_server(Goto, "auv1/goto", dive)
                server.close()
                client = shore.create_action_client(Goto, "auv1/goto")
                with pytest.raises(PayloadInvalidError):
                    await client.send_goal(Goto.Goal(depth="deep"))  # type: ignore[arg-type]
                with pytest.raises(LocalError, match="timeout_s is 0; allowed: above 0"):
                    await client.send_goal(Goto.Goal(depth=1.0), timeout_s=0)
                client.close()
                with pytest.raises(LocalError, match="the client of auv1/goto is closed"):
                    await client.send_goal(Goto.Goal(depth=1.0))

    run(main())


def test_without_a_config_client_and_server_share_the_id() -> None:
    async def main() -> None:
        with channel() as medium:
            auv = Node(2, link=medium.link(2))
            async with Node(1, link=medium.link(1)) as shore, auv:
                auv.create_action_server(Goto, "goto", dive, stream_id=30)
                client = shore.create_action_client(Goto, "goto", stream_id=30, server=2)
                handle = await client.send_goal(Goto.Goal(depth=7.0))
                assert (await handle.result()).result == Goto.Result(depth=7.0)

    run(main())


def test_whoever_stops_to_wait_for_the_answer_cancels_the_goal() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            begun = asyncio.Event()
            stopped = asyncio.Event()
            ended = asyncio.Event()

            async def decide(goal: Goto.Goal) -> bool:
                begun.set()
                await stopped.wait()
                return True

            async def pursue(handle: Handle) -> None:
                await handle.cancel_requested()
                handle.canceled()
                ended.set()

            async with shore, auv:
                auv.create_action_server(Goto, "auv1/goto", pursue, goal_callback=decide)
                client = shore.create_action_client(Goto, "auv1/goto")
                sending = asyncio.create_task(client.send_goal(Goto.Goal(depth=1.0)))
                await begun.wait()
                sending.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await sending
                stopped.set()
                await ended.wait()

    run(main())


def test_closing_a_node_ends_what_waits_and_closing_a_server_aborts() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with auv:
                async with shore:
                    server = auv.create_action_server(Goto, "auv1/goto", wait_for_cancel)
                    client = shore.create_action_client(Goto, "auv1/goto")
                    first = await client.send_goal(Goto.Goal(depth=1.0))
                    server.close()
                    assert (await first.result()).status is GoalStatus.ABORTED
                    auv.create_action_server(Goto, "auv1/goto", wait_for_cancel)
                    second = await client.send_goal(Goto.Goal(depth=1.0))
                    waiting = asyncio.create_task(second.result())
                    await asyncio.sleep(0)
                with pytest.raises(LinkClosedError):
                    await waiting

    run(main())


def test_goal_is_found_again_by_the_next_life_of_its_client(tmp_path: Path) -> None:
    async def main() -> None:
        with channel() as medium:
            goes_on = asyncio.Event()

            async def pursue(handle: Handle) -> Goto.Result:
                await goes_on.wait()
                handle.succeed()
                return Goto.Result(depth=3.0)

            async with Node("auv1", config=config(), link=medium.link(2)) as auv:
                auv.create_action_server(Goto, "auv1/goto", pursue)
                link = medium.link(1)
                async with Node("shore", config=config(), link=link, journal=tmp_path) as shore:
                    client = shore.create_action_client(Goto, "auv1/goto")
                    assert (await client.send_goal(Goto.Goal(depth=1.0), tag=b"leg 4")).accepted
                goes_on.set()
                link = medium.link(1)
                async with Node("shore", config=config(), link=link, journal=tmp_path) as shore:
                    (handle,) = shore.create_action_client(Goto, "auv1/goto").recovered()
                    assert handle.tag == b"leg 4"
                    result = await handle.result()
                    assert (result.status, result.result) == (
                        GoalStatus.SUCCEEDED,
                        Goto.Result(depth=3.0),
                    )
                    assert handle.accepted

    run(main())


def test_server_that_was_closed_has_aborted_and_one_that_died_leaves_an_unknown_end(
    tmp_path: Path,
) -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node("shore", config=config(), link=medium.link(1)) as shore:
                client = shore.create_action_client(Goto, "auv1/goto")
                for number, status in ((1, GoalStatus.ABORTED), (2, GoalStatus.UNKNOWN)):
                    alive, kept = tmp_path / f"alive{number}", tmp_path / f"kept{number}"
                    link = medium.link(2)
                    async with Node("auv1", config=config(), link=link, journal=alive) as auv:
                        auv.create_action_server(Goto, "auv1/goto", wait_for_cancel)
                        handle = await client.send_goal(Goto.Goal(depth=1.0))
                        # What a power loss would leave now.
                        shutil.copytree(alive, kept)
                        await link.close()
                    link, left = medium.link(2), alive if number == 1 else kept
                    async with Node("auv1", config=config(), link=link, journal=left):
                        result = await handle.result()
                        assert (result.status, result.result) == (status, None)

    run(main())
