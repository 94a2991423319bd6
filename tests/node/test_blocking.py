"""The facade for scripts: the same names, calls that wait, one thread."""

import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.node.fleet import Arm, ChannelServer, Goto, Nav, Raw, config, router
from zacoustic import DeliveryError, GoalStatus, LocalError, Sample, ServiceError, blocking
from zacoustic.core.engine.events import LinkStateChanged

LIMIT_S = 10.0


def settle(mode: str, *nodes: blocking.Node) -> None:
    """Wait until all on Zenoh know what these have declared; see `fleet.settle`."""
    for node in nodes if mode == "zenoh" else ():
        with pytest.raises(DeliveryError):
            node.create_client(Raw, "hush").call(b"")


@contextmanager
def no_thread_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    for thread in set(threading.enumerate()) - before:
        thread.join(2)
        assert not thread.is_alive(), f"{thread} is left"


@contextmanager
def two_nodes(mode: str) -> Iterator[tuple[blocking.Node, blocking.Node]]:
    """Give nodes on a link or on Zenoh."""
    with no_thread_left():
        if mode == "link":
            with (
                ChannelServer() as locator,
                blocking.Node("shore", config=config(), link=locator) as shore,
                blocking.Node("auv1", config=config(), link=locator) as auv,
            ):
                yield shore, auv
        else:
            with (
                router() as (endpoint, _),
                blocking.Node("shore", config=config(), connect=endpoint) as shore,
                blocking.Node("auv1", config=config(2), connect=endpoint) as auv,
            ):
                yield shore, auv


@pytest.mark.parametrize("mode", ["link", "zenoh"])
def test_the_same_endpoints_without_asyncio(mode: str) -> None:
    with two_nodes(mode) as (shore, auv):
        assert (shore.address, auv.address) == (1, 2)
        subscription = shore.subscribe(Nav, "auv1/nav")
        publisher = auv.create_publisher(Nav, "auv1/nav")
        settle(mode, shore, auv)
        publisher.publish(Nav(depth=3.0, mode="idle"))
        assert subscription.receive(timeout_s=LIMIT_S).value == Nav(depth=3.0, mode="idle")
        publisher.delete()
        assert next(subscription).deleted
        with pytest.raises(TimeoutError):
            subscription.receive(timeout_s=0.01)
        auv.create_service(Arm, "auv1/arm", lambda request: Arm.Response(ok=request.on))
        client = shore.create_client(Arm, "auv1/arm")
        settle(mode, auv, shore)
        assert client.call(Arm.Request(on=True), timeout_s=LIMIT_S).ok
        auv.flush(timeout_s=LIMIT_S)
        assert auv.stats.published[10] == 2
        assert bool(auv.ledger()) is (mode == "link")
        assert isinstance(next(shore.events()), LinkStateChanged)
        publisher.close()
        client.close()
        subscription.close()
        assert list(subscription) == []


@pytest.mark.parametrize("mode", ["link", "zenoh"])
def test_errors_come_out_as_they_are(mode: str) -> None:
    def refuse(request: bytes) -> bytes:
        raise RuntimeError("the battery is empty")

    with two_nodes(mode) as (shore, auv):
        service = auv.create_service(Raw, "auv1/echo", refuse)
        settle(mode, auv, shore)
        with pytest.raises(ServiceError, match="the battery is empty"):
            shore.create_client(Raw, "auv1/echo").call(b"x", timeout_s=LIMIT_S)
        service.close()
        with pytest.raises(LocalError, match="not a publisher"):
            shore.create_publisher(Nav, "auv1/nav")


def test_callbacks_may_publish_and_nothing_that_waits() -> None:
    refused: list[str] = []
    done = threading.Event()

    with two_nodes("link") as (shore, auv):
        answer = shore.create_publisher(bytes, "note")

        def callback(sample: Sample[Nav]) -> None:
            assert threading.current_thread() is not threading.main_thread()
            for wait in (
                lambda: shore.subscribe(bytes, "note"),
                lambda: shore.create_client(Raw, "auv1/echo"),
                lambda: subscription.receive(timeout_s=1),
                shore.flush,
                shore.close,
            ):
                try:
                    wait()
                except LocalError as error:
                    refused.append(str(error))
            answer.publish(b"seen")
            done.set()

        subscription = shore.create_subscription(Nav, "auv1/nav", callback)
        answers = auv.subscribe(bytes, "note")
        auv.create_publisher(Nav, "auv1/nav").publish(Nav(depth=3.0, mode="idle"))
        assert done.wait(LIMIT_S)
        assert answers.receive(timeout_s=LIMIT_S).value == b"seen"
    assert len(refused) == 5
    assert all("would wait for itself" in text for text in refused)


def test_iteration_in_one_thread_ends_when_another_closes_the_node() -> None:
    with two_nodes("link") as (shore, _):
        subscription = shore.subscribe(bytes, "note")
        seen: list[Sample[bytes]] = []
        reader = threading.Thread(target=lambda: seen.extend(subscription))
        reader.start()
        shore.close()
        reader.join(LIMIT_S)
        assert not reader.is_alive()
        assert seen == []


def test_a_node_that_is_not_open_says_so() -> None:
    with no_thread_left():
        node = blocking.Node("shore", config=config(), link="sim/127.0.0.1:1#wait_s=0.05")
        with pytest.raises(LocalError, match="node shore is not open"):
            node.create_publisher(bytes, "note")
        with pytest.raises(OSError, match="no medium"):
            node.open()
        node.close()
    with two_nodes("link") as (shore, _):
        publisher = shore.create_publisher(bytes, "note")
        with pytest.raises(LocalError, match="opened already"):
            shore.open()
        shore.close()
        with pytest.raises(LocalError, match="closed"):
            publisher.publish(b"x")
        with pytest.raises(LocalError, match="not open"):
            shore.ledger()


@pytest.mark.parametrize("mode", ["link", "zenoh"])
def test_actions_without_asyncio(mode: str) -> None:
    heard: queue.SimpleQueue[Goto.Feedback] = queue.SimpleQueue()

    def pursue(
        handle: blocking.ServerGoalHandle[Goto.Goal, Goto.Feedback, Goto.Result],
    ) -> Goto.Result:
        assert threading.current_thread() is not threading.main_thread()
        # Before the feedback: the client cancels as soon as it has that.
        assert not handle.wait_cancel(timeout_s=0.001)
        assert handle.publish_feedback(Goto.Feedback(left=handle.request.depth))
        if handle.request.depth < 100:
            handle.succeed()
        else:
            assert handle.is_active
            assert handle.wait_cancel(timeout_s=LIMIT_S)
            assert handle.is_cancel_requested
            handle.canceled()
        return Goto.Result(depth=handle.request.depth)

    with two_nodes(mode) as (shore, auv):
        server = auv.create_action_server(
            Goto, "auv1/goto", pursue, goal_callback=lambda goal: goal.depth < 1000
        )
        settle(mode, auv)
        client = shore.create_action_client(Goto, "auv1/goto")
        assert client.recovered() == []
        near = client.send_goal(Goto.Goal(depth=5.0), feedback_callback=heard.put)
        assert near.accepted
        assert near.result(timeout_s=LIMIT_S).result == Goto.Result(depth=5.0)
        far = client.send_goal(Goto.Goal(depth=500.0), tag=b"far", feedback_callback=heard.put)
        assert far.tag == b"far"
        while heard.get(timeout=LIMIT_S).left != 500.0:
            pass
        assert far.cancel()
        assert far.result(timeout_s=LIMIT_S).status is GoalStatus.CANCELED
        refused = client.send_goal(Goto.Goal(depth=5000.0))
        assert (refused.accepted, refused.text) == (False, "rejected")
        client.close()
        server.close()
