"""Actions of ROS 2 across two gateways."""

from typing import Any

from tests.gateway.networks import fence
from tests.gateway.rosnode import DEFAULT, LATCHED, Node, Told, reply
from tests.gateway.rospair import FIBONACCI, Pair, with_pair

NAME = "/fibonacci/_action"
CANCEL = "action_msgs/srv/CancelGoal"
STATUS = "action_msgs/msg/GoalStatusArray"
GOAL_ID = bytes(range(16))
OTHER_ID = bytes(range(16, 32))
NOW = {"sec": 1, "nanosec": 0}
NEVER = {"sec": 0, "nanosec": 0}


class Server:
    """An action server as rcl has it, led by the test."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self.goals = Told()
        self.cancels = Told()
        self.results = Told()
        self.accepts = True
        self._feedback = node.publisher(f"{NAME}/feedback", f"{FIBONACCI}_FeedbackMessage")
        node.publisher(f"{NAME}/status", STATUS, LATCHED)
        node.serve(f"{NAME}/send_goal", f"{FIBONACCI}_SendGoal", self._send)
        node.serve(f"{NAME}/get_result", f"{FIBONACCI}_GetResult", self._result)
        node.serve(f"{NAME}/cancel_goal", CANCEL, self._cancel)

    def _send(self, asked: dict[str, Any]) -> dict[str, Any]:
        self.goals.tell(asked)
        return {"accepted": self.accepts, "stamp": NOW}

    def _result(self, asked: dict[str, Any]) -> None:
        self.results.tell(asked)

    def _cancel(self, asked: dict[str, Any]) -> dict[str, Any]:
        self.cancels.tell(asked["goal_info"]["goal_id"])
        return {"return_code": 0, "goals_canceling": [asked["goal_info"]]}

    def feed(self, goal: dict[str, Any], sequence: list[int]) -> None:
        self._feedback({"goal_id": goal["goal_id"], "feedback": {"sequence": sequence}})

    async def end(self, status: int, sequence: list[int]) -> None:
        """Answer the question for a result that has been asked for longest."""
        await self.results.next()
        query = self._node.held().pop(0)
        self._node.forget(query)
        message = self._node.message(f"{FIBONACCI}_GetResult_Response")
        reply(query, message.write({"status": status, "result": {"sequence": sequence}}))


class Client:
    """An action client as rcl has it."""

    def __init__(self, node: Node) -> None:
        self.feedback = node.subscribe(f"{NAME}/feedback", f"{FIBONACCI}_FeedbackMessage", DEFAULT)
        self.status = node.subscribe(f"{NAME}/status", STATUS, LATCHED)
        self._send = node.client(f"{NAME}/send_goal", f"{FIBONACCI}_SendGoal")
        self._get = node.client(f"{NAME}/get_result", f"{FIBONACCI}_GetResult")
        self._cancel = node.client(f"{NAME}/cancel_goal", CANCEL)

    async def send(self, order: int, goal_id: bytes = GOAL_ID) -> bool:
        asked = {"goal_id": {"uuid": goal_id}, "goal": {"order": order}}
        ((answer, _),) = await self._send.call(asked)
        return bool(answer["accepted"])

    def result(self, goal_id: bytes = GOAL_ID) -> Told:
        return self._get.ask({"goal_id": {"uuid": goal_id}})

    async def cancel(self, goal_id: bytes = GOAL_ID) -> dict[str, Any]:
        asked = {"goal_info": {"goal_id": {"uuid": goal_id}, "stamp": NEVER}}
        ((answer, _),) = await self._cancel.call(asked)
        return answer

    async def until_status(self, *wanted: int) -> None:
        """Wait until the goals have these states."""
        while True:
            value, _ = await self.status.next()
            if [each["status"] for each in value["status_list"]] == list(wanted):
                return


async def opened(pair: Pair) -> tuple[Server, Client]:
    server, client = Server(pair.auv), Client(pair.shore)
    await fence(pair.auv.session)
    await fence(pair.shore.session)
    return server, client


@with_pair()
async def test_a_goal_is_accepted_fed_and_ended(pair: Pair) -> None:
    server, client = await opened(pair)
    assert await client.send(10)
    goal = await server.goals.next()
    assert goal["goal"] == {"order": 10}
    assert goal["goal_id"]["uuid"] != GOAL_ID, "names of goals do not cross"
    await client.until_status(2)
    result = client.result()
    for length in range(2, 5):
        server.feed(goal, list(range(length)))
        value, _ = await client.feedback.next()
        assert value["goal_id"] == {"uuid": GOAL_ID}
        assert value["feedback"] == {"sequence": list(range(length))}
    await server.end(4, [0, 1, 1, 2, 3])
    value, _ = await result.next()
    assert value == {"status": 4, "result": {"sequence": [0, 1, 1, 2, 3]}}
    await client.until_status(4)
    # Whoever asks later is answered from what was kept.
    assert (await client.result().next())[0] == value


@with_pair()
async def test_a_goal_can_be_refused(pair: Pair) -> None:
    server, client = await opened(pair)
    server.accepts = False
    assert not await client.send(10)
    assert server.results.empty()


@with_pair()
async def test_a_goal_can_be_cancelled(pair: Pair) -> None:
    server, client = await opened(pair)
    assert await client.send(10)
    goal = await server.goals.next()
    result = client.result()
    answer = await client.cancel()
    assert await server.cancels.next() == goal["goal_id"]
    assert answer["return_code"] == 0
    assert [each["goal_id"]["uuid"] for each in answer["goals_canceling"]] == [GOAL_ID]
    await client.until_status(3)
    await server.end(5, [0, 1])
    value, _ = await result.next()
    assert value == {"status": 5, "result": {"sequence": [0, 1]}}
    await client.until_status(5)


@with_pair()
async def test_all_goals_can_be_cancelled_at_once(pair: Pair) -> None:
    server, client = await opened(pair)
    goals = []
    for goal_id in (GOAL_ID, OTHER_ID):
        assert await client.send(10, goal_id)
        goals.append((await server.goals.next())["goal_id"])
    answer = await client.cancel(bytes(16))
    canceling = {each["goal_id"]["uuid"] for each in answer["goals_canceling"]}
    assert canceling == {GOAL_ID, OTHER_ID}
    cancelled = [await server.cancels.next() for _ in goals]
    assert sorted(each["uuid"] for each in cancelled) == sorted(each["uuid"] for each in goals)


@with_pair()
async def test_what_is_not_known_gets_an_answer_that_clients_of_ros_understand(
    pair: Pair,
) -> None:
    _, client = await opened(pair)
    value, _ = await client.result(OTHER_ID).next()
    assert value == {"status": 0, "result": {"sequence": []}}
    answer = await client.cancel(OTHER_ID)
    assert answer["return_code"] != 0
    assert answer["goals_canceling"] == []


@with_pair()
async def test_without_a_server_a_goal_is_not_accepted(pair: Pair) -> None:
    client = Client(pair.shore)
    await fence(pair.shore.session)
    assert not await client.send(3)


@with_pair()
async def test_two_goals_are_told_apart(pair: Pair) -> None:
    server, client = await opened(pair)
    for goal_id in (GOAL_ID, OTHER_ID):
        assert await client.send(5, goal_id)
    one, other = await server.goals.next(), await server.goals.next()
    server.feed(other, [9])
    value, _ = await client.feedback.next()
    assert value["goal_id"]["uuid"] == OTHER_ID
    server.feed(one, [1])
    value, _ = await client.feedback.next()
    assert value["goal_id"]["uuid"] == GOAL_ID
    results = client.result(), client.result(OTHER_ID)
    await server.end(4, [1])
    await server.end(6, [2])
    first, _ = await results[0].next()
    second, _ = await results[1].next()
    assert sorted((first["status"], second["status"])) == [4, 6]
    await client.until_status(first["status"], second["status"])


@with_pair(frame_loss=0.3)
async def test_over_channel_that_loses_a_third_a_goal_runs_once_and_ends(pair: Pair) -> None:
    server, client = await opened(pair)
    assert await client.send(10)
    goal = await server.goals.next()
    result = client.result()
    numbers = [0, 1]
    for _ in range(10):
        numbers.append(numbers[-1] + numbers[-2])
        server.feed(goal, numbers)
    await server.end(4, numbers)
    value, beside = await result.next()
    assert value == {"status": 4, "result": {"sequence": numbers}}
    assert beside.sequence == 1
    await client.until_status(4)
    assert server.goals.empty()
    # Of the feedback nothing is wrong, whatever has arrived.
    while not client.feedback.empty():
        fed = (await client.feedback.next())[0]["feedback"]["sequence"]
        assert fed == numbers[: len(fed)]
