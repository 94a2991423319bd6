"""Goals over gateways: sent on one local network, pursued on another, on real Zenoh sessions."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import cbor2
import msgspec
import zenoh

from tests.gateway.networks import (
    Channel,
    Heard,
    LocalNetwork,
    config_of,
    fence,
    free_port,
    get,
    hear,
    local_network,
    run,
    until,
    zenoh_config,
)
from zacoustic.gateway import Gateway
from zacoustic.zenoh.session.marker import Marker, read_marker

GOAL_ID = bytes(range(16))
OTHER_ID = bytes(range(16, 32))


class Program:
    """A program on the vehicle that serves an action by hand."""

    def __init__(self, session: zenoh.Session, name: str, *, accepts: bool = True) -> None:
        self.name = name
        self.goals: list[tuple[bytes, Any, Marker | None]] = []
        self.cancels: list[zenoh.Query] = []
        self.changed = asyncio.Event()
        self._accepts = accepts
        self._session = session
        self._results: dict[bytes, zenoh.Query] = {}
        self._loop = asyncio.get_running_loop()
        self._queryable = session.declare_queryable(
            f"{name}/_action/*",
            lambda query: self._loop.call_soon_threadsafe(self._take, query),
            complete=True,
        )

    def _take(self, query: zenoh.Query) -> None:
        assert query.payload is not None
        said = cbor2.loads(query.payload.to_bytes())
        what = str(query.key_expr).rpartition("/")[2]
        if what == "send_goal":
            self.goals.append((said["goal_id"], said["goal"], read_marker(query.attachment)))
            verdict = {"accepted": self._accepts, "text": "" if self._accepts else "too deep"}
            self._reply(query, verdict)
        elif what == "cancel_goal":
            self.cancels.append(query)
        else:
            self._results[said["goal_id"]] = query
        self.changed.set()

    def _reply(self, query: zenoh.Query, said: Any) -> None:
        query.reply(query.key_expr, cbor2.dumps(said), encoding="application/cbor")
        query.drop()  # type: ignore[no-untyped-call]

    def feed(self, **feedback: float) -> None:
        """Put feedback for the last goal."""
        goal_id, _, _ = self.goals[-1]
        said = {"goal_id": goal_id, "feedback": feedback}
        self._session.put(
            f"{self.name}/_action/feedback", cbor2.dumps(said), encoding="application/cbor"
        )

    def answer_cancel(self, *, accepted: bool) -> None:
        """Answer the last cancel."""
        self._reply(self.cancels.pop(), {"accepted": accepted, "text": "not now"})

    async def finish(self, status: str, result: Any) -> None:
        """Answer the last goal's result as soon as it is asked for."""
        goal_id, _, _ = self.goals[-1]
        await until(lambda: goal_id in self._results, self.changed)
        self._reply(self._results.pop(goal_id), {"status": status, "result": result})

    def die(self) -> None:
        """End without a word."""
        self._queryable.undeclare()  # type: ignore[no-untyped-call]
        for query in self._results.values():
            query.drop()  # type: ignore[no-untyped-call]


class Shore:
    """A program on the shore that sends goals by hand."""

    def __init__(self, session: zenoh.Session, name: str) -> None:
        self.session = session
        self.name = name

    async def ask(self, what: str, goal_id: bytes = GOAL_ID, **said: Any) -> Any:
        """Ask; returns what was answered, or the text of the error."""
        replies = await get(
            self.session,
            f"{self.name}/_action/{what}",
            cbor2.dumps({"goal_id": goal_id, **said}),
            encoding="application/cbor",
        )
        if replies.errors:
            return replies.errors[0]
        (reply,) = replies.good.values()
        assert reply.attachment is not None
        assert read_marker(reply.attachment.to_bytes()) == Marker(acoustic=2)
        return cbor2.loads(reply.payload.to_bytes())


@asynccontextmanager
async def two_networks(
    name: str = "auv1/goto", **settings: Any
) -> AsyncIterator[tuple[Shore, Program, Heard]]:
    """Give the program on the shore, the one on the vehicle, and what the shore hears."""
    async with AsyncExitStack() as stack:
        channel = Channel()
        shore = await stack.enter_async_context(local_network(1, channel))
        vehicle = await stack.enter_async_context(local_network(2, channel))
        asking = stack.enter_context(shore.client())
        serving = stack.enter_context(vehicle.client())
        program = Program(serving, name, **settings)
        await fence(serving)
        heard = await hear(asking, f"{name}/_action/feedback")
        yield Shore(asking, name), program, heard


def test_goal_feedback_and_result_cross() -> None:
    async def main() -> None:
        async with two_networks() as (shore, program, heard):
            answer = await shore.ask("send_goal", goal={"depth": 12.5})
            assert answer == {"accepted": True, "failure": None, "text": ""}
            ((_, goal, marker),) = program.goals
            assert (goal, marker) == ({"depth": 12.5}, Marker(acoustic=1))
            again = await shore.ask("send_goal", goal={"depth": 12.5})
            assert again == answer
            assert len(program.goals) == 1
            program.feed(left=3.0)
            sample = await heard.next()
            assert cbor2.loads(sample.payload.to_bytes()) == {
                "goal_id": GOAL_ID,
                "feedback": {"left": 3.0},
            }
            assert read_marker(sample.attachment) == Marker(acoustic=2)
            waiting = asyncio.ensure_future(shore.ask("get_result"))
            await program.finish("succeeded", {"depth": 12.0})
            ended = {"status": "succeeded", "result": {"depth": 12.0}, "text": ""}
            assert await waiting == ended
            assert await shore.ask("get_result") == ended
            over = await shore.ask("cancel_goal")
            assert (over["accepted"], over["text"]) == (False, "the goal is over")

    run(main())


def test_cancel_crosses_and_its_answer_too() -> None:
    async def main() -> None:
        async with two_networks() as (shore, program, _):
            status = await hear(shore.session, "auv1/goto/_action/status")
            for accepted, goal_id in ((False, OTHER_ID), (True, GOAL_ID)):
                await shore.ask("send_goal", goal_id, goal={"depth": 1.0})
                waiting = asyncio.ensure_future(shore.ask("cancel_goal", goal_id))
                await until(lambda: program.cancels, program.changed)
                program.answer_cancel(accepted=accepted)
                answer = await waiting
                assert answer["accepted"] is accepted
                assert answer["text"] == ("" if accepted else "not now")
            ending = asyncio.ensure_future(shore.ask("get_result"))
            await program.finish("canceled", None)
            assert await ending == {"status": "canceled", "result": None, "text": ""}
            said = [cbor2.loads(await status.payload())["status"] for _ in range(4)]
            assert said == ["executing", "executing", "canceling", "canceled"]

    run(main())


def test_rejected_goal_says_why_and_has_no_result() -> None:
    async def main() -> None:
        async with two_networks(accepts=False) as (shore, _, _):
            answer = await shore.ask("send_goal", goal={"depth": 900.0})
            assert answer == {"accepted": False, "failure": "REJECTED", "text": "too deep"}
            text = await shore.ask("get_result")
            assert text == "auv1/goto/_action/get_result: BAD_REQUEST: too deep"

    run(main())


def test_nobody_who_serves_is_said() -> None:
    async def main() -> None:
        async with two_networks() as (shore, program, _):
            program.die()
            answer = await shore.ask("send_goal", goal={"depth": 900.0})
            assert (answer["accepted"], answer["failure"]) == (False, "NO_SERVER")

    run(main())


def test_program_that_dies_leaves_an_unknown_end(monkeypatch: Any) -> None:
    monkeypatch.setattr("zacoustic.zenoh.gateway.streams.actions.PROGRAM_PATIENCE_S", 0.2)

    async def main() -> None:
        async with two_networks() as (shore, program, _):
            await shore.ask("send_goal", goal={"depth": 900.0})
            await until(lambda: program._results, program.changed)
            program.die()
            ended = await shore.ask("get_result")
            assert (ended["status"], ended["result"]) == ("unknown", None)

    run(main())


def test_opaque_actions_carry_bytes_and_several_goals_at_once() -> None:
    async def main() -> None:
        async with two_networks("auv1/raw") as (shore, program, _):
            await shore.ask("send_goal", goal=b"\x00\xff")
            await shore.ask("send_goal", OTHER_ID, goal=b"other")
            assert [goal for _, goal, _ in program.goals] == [b"\x00\xff", b"other"]
            waiting = asyncio.ensure_future(shore.ask("get_result", OTHER_ID))
            await program.finish("aborted", b"\x01")
            assert await waiting == {"status": "aborted", "result": b"\x01", "text": ""}

    run(main())


def test_mistakes_are_refused_on_the_spot() -> None:
    async def main() -> None:
        async with two_networks() as (shore, program, _):
            for what, said, text in (
                ("send_goal", {"goal": {"depth": "deep"}}, "BAD_REQUEST"),
                ("send_goal", {"goal": {"depht": 1.0}}, "BAD_REQUEST"),
                ("send_goal", {}, "goal is missing"),
                ("get_result", {}, f"no goal {GOAL_ID.hex()} is known"),
                ("cancel_goal", {}, f"no goal {GOAL_ID.hex()} is known"),
                ("get_result", {"goal_id": 7}, "goal_id is 7; allowed: 16 bytes"),
                ("*", {"goal": {"depth": 1.0}}, "a wildcard sends no goal"),
            ):
                asked: dict[str, Any] = {"goal_id": GOAL_ID} | said
                assert text in await shore.ask(what, **asked)
            marked = await get(
                shore.session,
                "auv1/goto/_action/send_goal",
                cbor2.dumps({"goal_id": GOAL_ID, "goal": {"depth": 1.0}}),
                encoding="application/cbor",
                attachment=Marker(acoustic=3).encode(),
            )
            assert "the goal came off the channel, it does not go back" in marked.errors[0]
            assert not (await get(shore.session, "auv1/goto/_action/status")).good
            assert program.goals == []

    run(main())


def test_json_programs_name_goals_by_hexadecimal_digits() -> None:
    async def main() -> None:
        async with two_networks() as (shore, program, _):
            said = {"goal_id": GOAL_ID.hex(), "goal": {"depth": 2.0}}
            replies = await get(
                shore.session,
                "auv1/goto/_action/send_goal",
                json.dumps(said).encode(),
                encoding="application/json",
            )
            assert cbor2.loads(replies.payload("auv1/goto/_action/send_goal"))["accepted"]
            assert program.goals[0][1] == {"depth": 2.0}

    run(main())


def test_restarted_gateway_still_knows_the_goals_of_its_local_network(tmp_path: Path) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            vehicle = await stack.enter_async_context(local_network(2, channel))
            serving = stack.enter_context(vehicle.client())
            program = Program(serving, "auv1/goto")
            await fence(serving)
            port = free_port()
            for life in (1, 2):
                config = msgspec.structs.replace(
                    config_of(1, zenoh_config("router", listen=port)), journal=tmp_path
                )
                async with Gateway(config, link=channel.medium.link(1)):
                    with LocalNetwork(port).client() as session:
                        shore = Shore(session, "auv1/goto")
                        if life == 1:
                            assert (await shore.ask("send_goal", goal={"depth": 4.0}))["accepted"]
                            continue
                        waiting = asyncio.ensure_future(shore.ask("get_result"))
                        await program.finish("succeeded", {"depth": 4.0})
                        ended = await waiting
                        assert (ended["status"], ended["result"]) == ("succeeded", {"depth": 4.0})
            assert len(program.goals) == 1

    run(main())
