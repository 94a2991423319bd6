"""Lost contact on real Zenoh: the gateway alone calls and publishes until somebody answers."""

import asyncio
import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cbor2
import pytest
import zenoh

from tests.gateway.networks import (
    LIMIT_S,
    SECTION,
    Channel,
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
from tests.gateway.rosnode import Node, ros_session
from zacoustic.app.tools.field.doctor.network import Running
from zacoustic.app.tools.field.doctor.running import judge
from zacoustic.config import Config, config_from_mapping
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.gateway import Gateway, Notice, read_marker
from zacoustic.link.contract import Finding, LinkReceiver
from zacoustic.run.hostclock import HostClock
from zacoustic.run.journal import SqliteJournal, journal_in
from zacoustic.zenoh.gateway import lostcontact
from zacoustic.zenoh.gateway.lostcontact import pause_s
from zacoustic_sim.link import SimLink

AFTER_S = 0.3
KEY = "auv1/surface"
HERE = HostClock(boot=b"one")


def section(**entry: Any) -> dict[str, Any]:
    given: dict[str, Any] = {"name": "up", "of": [1], "lost_after_s": AFTER_S, "by": 2}
    return SECTION | {"lost_contact": [given | entry]}


def said(where: LocalNetwork) -> list[Notice]:
    return where.told("lost_contact")


def states(where: LocalNetwork) -> list[str]:
    return [each.facts["state"] for each in said(where)]


def links(where: LocalNetwork) -> list[str]:
    return [each.facts["state"] for each in where.told("link")]


async def document(session: zenoh.Session) -> dict[str, Any]:
    key = "@acoustic/2/contact/up"
    found: dict[str, Any] = json.loads((await get(session, key)).payload(key))
    return found


class Server:
    """A local service whose answers the test sets; its callbacks are on a thread of Zenoh."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.answer: Callable[[zenoh.Query], None] = failing
        self.asked: list[tuple[bytes, str | None]] = []
        self._guard = threading.Lock()
        session.declare_queryable(key, self._serve)

    def _serve(self, query: zenoh.Query) -> None:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        mark = read_marker(query.attachment)
        with self._guard:
            self.asked.append((payload, mark.call if mark is not None else None))
        with query:
            self.answer(query)


def failing(query: zenoh.Query) -> None:
    query.reply_err(b"no air in the bottle")


def refusing(query: zenoh.Query) -> None:
    query.reply(KEY, json.dumps({"success": False}), encoding="application/json")


def agreeing(query: zenoh.Query) -> None:
    query.reply(KEY, cbor2.dumps({"success": True}), encoding="application/cbor")


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lostcontact, "FIRST_PAUSE_S", 0.05)
    monkeypatch.setattr(lostcontact, "LAST_PAUSE_S", 0.2)


def test_pauses_grow_up_to_half_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert [pause_s(count) for count in (1, 2, 3, 4, 5, 6, 1000)] == [1, 2, 4, 8, 16, 30, 30]


def test_service_is_called_until_it_answers_and_again_after_the_next_loss() -> None:
    async def scene() -> None:
        channel, rule = Channel(), section(call=KEY, value={"depth": 0})
        async with local_network(2, channel, section=rule, host=HERE) as auv:
            with auv.client() as client:
                await until(lambda: states(auv) == ["lost", "unanswered"], auv.changed)
                assert "NO_SERVER: nobody serves auv1/surface" in said(auv)[1].facts["detail"]
                server = Server(client, KEY)
                for answer, reason in ((failing, "no air"), (refusing, '"success":false')):
                    server.answer = answer
                    expected = len(states(auv)) + 1
                    await until(lambda count=expected: len(states(auv)) >= count, auv.changed)  # type: ignore[misc]
                    assert reason in said(auv)[-1].facts["detail"]
                    assert said(auv)[-1].facts["state"] == "unanswered"
                failed = await document(client)
                assert failed["state"] == "lost"
                assert failed["attempts"] >= 3
                assert "success" in failed["failure"]
                server.answer = agreeing
                await until(lambda: states(auv)[-1] == "acted", auv.changed)
                acted = await document(client)
                assert acted["state"] == "acted"
                assert (acted["call"], acted["of"], acted["failure"]) == (KEY, [1], "")
                assert acted["answer"] == '{"success":true}'
                assert acted["acts_at_unix_s"] is None
                calls = len(server.asked)
                payloads, marks = zip(*server.asked, strict=True)
                assert set(payloads) == {cbor2.dumps({"depth": 0})}
                (mark,) = set(marks)
                assert mark.startswith("2/lost/up/")
                async with local_network(1, channel) as shore:
                    assert len(server.asked) == calls  # once
                    with shore.client() as crew:
                        crew.put("chat", b"here we are")
                        await until(lambda: "restored" in states(auv), auv.changed)
                await until(lambda: states(auv)[-2:] == ["lost", "acted"], auv.changed)
                assert len(server.asked) == calls + 1
                assert server.asked[-1][1] != mark

    run(scene())


def test_typed_service_of_this_node_is_called_with_its_type() -> None:
    async def scene() -> None:
        rule = section(call="auv1/arm", value={"arm": False})
        async with local_network(2, Channel(), section=rule) as auv:
            with auv.client() as client:
                server = Server(client, "auv1/arm")
                server.answer = lambda query: query.reply("auv1/arm", cbor2.dumps({"ok": True}))
                await until(lambda: states(auv)[-1:] == ["acted"], auv.changed)
                assert cbor2.loads(server.asked[-1][0]) == {"arm": False}

    run(scene())


def test_server_that_never_answers_is_asked_again() -> None:
    async def scene() -> None:
        rule = section(call=KEY, timeout_s=0.1)
        async with local_network(2, Channel(), section=rule) as auv:
            with auv.client() as client:
                held: list[zenoh.Query] = []
                client.declare_queryable(KEY, held.append)
                await until(
                    lambda: any("TIMED_OUT" in each.facts["detail"] for each in said(auv)),
                    auv.changed,
                )
                while len(held) < 2:
                    await document(client)

    run(scene())


def test_key_is_published_until_somebody_subscribes() -> None:
    async def scene() -> None:
        rule = section(publish=KEY, value="abort", encoding="application/json")
        async with local_network(2, Channel(), section=rule) as auv:
            with auv.client() as client:
                await until(lambda: states(auv) == ["lost", "unanswered"], auv.changed)
                assert "nobody subscribes to auv1/surface" in said(auv)[1].facts["detail"]
                heard = await hear(client, KEY)
                sample = await heard.next()
                assert sample.payload.to_bytes() == b'"abort"'
                assert str(sample.encoding) == "application/json"
                mark = read_marker(sample.attachment)
                assert mark is not None
                assert mark.acoustic == 2
                await until(lambda: states(auv)[-1] == "acted", auv.changed)
                count = len(heard.samples)
                await fence(client)
                assert len(heard.samples) == count
                assert (await document(client))["publish"] == KEY

    run(scene())


@pytest.mark.parametrize("word", ["call", "publish"])
def test_it_is_known_before_the_loss_whether_somebody_would_act(word: str) -> None:
    async def scene() -> None:
        rule = section(**{word: KEY}, lost_after_s=3600)
        async with local_network(2, Channel(), section=rule) as auv:
            with auv.client() as client:

                async def until_served(expected: bool) -> dict[str, Any]:
                    async with asyncio.timeout(LIMIT_S):
                        while (found := await document(client))["served"] is not expected:
                            pass
                    return found

                found = await until_served(False)
                assert (found["state"], found["attempts"]) == ("counting", 0)
                config = config_of(2, zenoh_config("client", connect=auv.port), rule)
                health = {"contact/up": found, "node": {}}
                (finding,) = of_doctor(config, health)
                assert KEY in finding.what
                if word == "call":
                    there: Any = client.declare_queryable(KEY, lambda _: None)
                else:
                    there = client.declare_subscriber(KEY, lambda _: None)
                health["contact/up"] = await until_served(True)
                assert of_doctor(config, health) == []
                there.undeclare()
                await until_served(False)
                assert states(auv) == []

    run(scene())


def of_doctor(config: Config, health: dict[str, Any]) -> list[Finding]:
    """Return what the doctor says of the actions at lost contact."""
    said = judge(config, Running(health=health))
    return [each for each in said if "lost_contact" in each.what]


def test_restart_acts_again_only_if_nobody_has_answered(tmp_path: Path) -> None:
    def journal() -> SqliteJournal:
        return journal_in(tmp_path, 2)

    async def scene() -> None:
        rule = section(call=KEY)
        async with local_network(2, Channel(), section=rule, journal=journal(), host=HERE) as auv:
            await until(lambda: "unanswered" in states(auv), auv.changed)
        async with local_network(2, Channel(), section=rule, journal=journal(), host=HERE) as auv:
            with auv.client() as client:
                Server(client, KEY).answer = agreeing
                await until(lambda: states(auv)[-1:] == ["acted"], auv.changed)
        async with local_network(2, Channel(), section=rule, journal=journal(), host=HERE) as auv:
            with auv.client() as client:
                found = await document(client)
                assert (found["state"], found["attempts"]) == ("acted", 0)
                assert states(auv) == []
        other = HostClock(boot=b"two")
        async with local_network(2, Channel(), section=rule, journal=journal(), host=other) as auv:
            await until(lambda: states(auv)[:1] == ["lost"], auv.changed)

    run(scene())


def without_modem(found: LocalNetwork, link: SimLink) -> Gateway:
    config = config_of(2, zenoh_config("router", listen=found.port), section(call=KEY))
    return Gateway(config, link=link, notify=found.notify)


def test_gateway_without_its_modem_starts_and_acts(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> None:
        found, link = LocalNetwork(free_port()), Channel().medium.link(2)
        really, is_there = link.open, False

        async def open_it(receiver: LinkReceiver) -> None:
            if not is_there:
                raise LinkOpenError("no such port")
            await really(receiver)

        monkeypatch.setattr(link, "open", open_it)
        async with without_modem(found, link):
            (started,) = found.told("started")
            assert "lost_contact without a journal" in started.facts["forgotten"]
            with found.client() as client:
                Server(client, KEY).answer = agreeing
                await until(lambda: states(found)[-1:] == ["acted"], found.changed)
            is_there = True
            await until(lambda: "up" in links(found), found.changed)

    run(scene())


def test_gateway_acts_while_its_modem_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene() -> None:
        found, link = LocalNetwork(free_port()), Channel().medium.link(2)
        really, opens = link.open, asyncio.Event()

        async def open_it(receiver: LinkReceiver) -> None:
            await opens.wait()
            await really(receiver)

        monkeypatch.setattr(link, "open", open_it)
        gateway = without_modem(found, link)
        starting = asyncio.create_task(gateway.start())
        await until(lambda: "unanswered" in states(found), found.changed)
        assert not starting.done()
        opens.set()
        await starting
        await gateway.close()

    run(scene())


def test_gateway_for_another_node_does_nothing() -> None:
    async def scene() -> None:
        async with local_network(1, Channel(), section=section(call=KEY)) as shore:
            with shore.client() as client:
                assert not (await get(client, "@acoustic/1/contact/**")).good

    run(scene())


TRIGGER = "std_srvs/srv/Trigger"
ROS: dict[str, Any] = {
    "address": 2,
    "nodes": SECTION["nodes"],
    "ros": {"domain": 7},
    "streams": [
        {"id": 20, "service": "/auv1/surface", "type": TRIGGER, "server": 2, "ros": {}},
        {"id": 21, "topic": "/auv1/text", "type": "std_msgs/msg/String", "ros": {}},
    ],
    "lost_contact": [
        {"name": "up", "of": [1], "lost_after_s": AFTER_S, "by": 2, "call": "/auv1/surface"}
    ],
}


def test_service_of_ros_is_called_until_it_says_success() -> None:
    async def scene() -> None:
        async with local_network(2, Channel(), section=ROS) as auv:
            with ros_session(auv.port) as session:
                node, answers = Node(session, "autopilot", domain=7), [False, True]

                def surface(asked: dict[str, Any]) -> dict[str, Any]:
                    return {"success": answers.pop(0), "message": "in the net"}

                node.serve("/auv1/surface", TRIGGER, surface)
                await until(lambda: states(auv)[-1:] == ["acted"], auv.changed)
                assert any('"success":false' in each.facts["detail"] for each in said(auv))
                assert answers == []

    run(scene())


def test_topic_of_ros_is_refused_with_what_to_do() -> None:
    entry = {"name": "up", "lost_after_s": 60, "by": 2, "publish": "/auv1/text"}
    with pytest.raises(ConfigError, match="is a topic of ROS 2; allowed: a key of Zenoh") as caught:
        config_from_mapping(ROS | {"lost_contact": [entry]}, source="f")
    assert "call a service" in caught.value.hint
