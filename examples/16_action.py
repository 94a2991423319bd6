"""Send a vehicle a goal: it says how far it is, and a cancelled goal ends with where it was.

Run it: python examples/16_action.py

With ROS types and `ros: {}` in the file, `ros2 action send_goal` does the same (docs/ros2.md). From
a shell: zacoustic action send_goal auv1/dive '{ depth: 40 }' --config examples/16_action.json5
"""

import asyncio

import msgspec

from zacoustic import GoalStatus, Node, ServerGoalHandle
from zacoustic.testing import NodeSpec, Scenario
from zacoustic_sim import SimMedium

FLEET = __file__.replace(".py", ".json5")  # ids, ranges and steps are there
TIME_SCALE = 20.0  # times faster than real, so that nobody waits


class Dive:
    """An action is a class with three classes in it, as in ROS."""

    class Goal(msgspec.Struct):
        """Go so deep."""

        depth: float

    class Feedback(msgspec.Struct):
        """So deep now."""

        depth: float

    class Result(msgspec.Struct):
        """So deep at the end."""

        reached: float


async def dive(
    goal: ServerGoalHandle[Dive.Goal, Dive.Feedback, Dive.Result],
) -> Dive.Result:
    """Go down a metre a second, until the goal is reached or cancelled."""
    depth = 0.0
    while depth < goal.request.depth and not goal.is_cancel_requested:
        await asyncio.sleep(1 / TIME_SCALE)
        depth += 1
        goal.publish_feedback(Dive.Feedback(depth=depth))
    if goal.is_cancel_requested:
        goal.canceled()
    else:
        goal.succeed()
    return Dive.Result(reached=depth)


async def main() -> None:
    nodes = tuple(NodeSpec(address=n, position=(1000.0 * n, 0.0, 20.0)) for n in (1, 2))
    medium = SimMedium(Scenario(nodes=nodes, channel="none"), time_scale=TIME_SCALE)
    async with (
        Node("auv1", config=FLEET, link=medium.link(2)) as auv1,
        Node("shore", config=FLEET, link=medium.link(1)) as shore,
    ):
        auv1.create_action_server(Dive, "auv1/dive", dive)
        client = shore.create_action_client(Dive, "auv1/dive")

        def show(feedback: Dive.Feedback) -> None:
            print(f"shore: at {feedback.depth:g} m")

        goal = await client.send_goal(Dive.Goal(depth=12), feedback_callback=show)
        print("shore: accepted" if goal.accepted else f"shore: rejected: {goal.text}")
        ended = await goal.result()
        print("shore:", ended.status.name, ended.result)
        assert ended.status is GoalStatus.SUCCEEDED

        goal = await client.send_goal(Dive.Goal(depth=300), feedback_callback=show)
        await asyncio.sleep(20 / TIME_SCALE)
        print("shore: the server agrees to cancel:", await goal.cancel())
        ended = await goal.result()
        print("shore:", ended.status.name, ended.result)
        assert ended.status is GoalStatus.CANCELED
    medium.close()


if __name__ == "__main__":
    asyncio.run(main())
