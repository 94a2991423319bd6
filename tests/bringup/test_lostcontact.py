"""The node on real Zenoh, with a gateway that has lost contact and a mission of another node."""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from tests.bringup.conftest import PACKAGE
from tests.bringup.rosstandin import Here, Placed
from tests.bringup.test_package import parameters
from tests.gateway.networks import Channel, LocalNetwork, local_network, run, until, zenoh_router
from tests.gateway.rosnode import Node, ros_session
from tests.gateway.test_lostcontact import states
from zacoustic.json5 import read_json5
from zacoustic.zenoh.gateway import lostcontact

TRIGGER = "std_srvs/srv/Trigger"


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lostcontact, "FIRST_PAUSE_S", 0.05)
    monkeypatch.setattr(lostcontact, "LAST_PAUSE_S", 0.1)
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)


def section() -> dict[str, Any]:
    """Return the section of the package's own file, whose crew is lost at once."""
    written: Any = read_json5(PACKAGE / "config" / "fleet.json5")
    found: dict[str, Any] = written["plugins"]["acoustic"]
    (rule,) = found["lost_contact"]
    nodes = [{"address": each["address"], "name": each["name"]} for each in found["nodes"]]
    return found | {"nodes": nodes, "lost_contact": [rule | {"lost_after_s": 0.3}]}


@contextmanager
def started(session: zenoh.Session, **given: Any) -> Iterator[tuple[Any, list[str]]]:
    """Start the node with the package's own parameters, some of them changed."""
    here = Here(session, namespace="/auv1", parameters=parameters() | given)
    with Placed(here):
        yield importlib.import_module("zacoustic_bringup.lost_contact").LostContact(), here.logged


async def asked(what: str, logged: list[str], auv: LocalNetwork) -> None:
    """Wait for a call of the gateway that reached the node: one before the node is there fails."""
    await until(lambda: any(what in each for each in logged), auv.changed)


def test_the_gateway_is_told_when_the_mission_has_agreed_to_end() -> None:
    async def scene() -> None:
        async with local_network(2, Channel(), section=section()) as auv:
            with ros_session(auv.port) as session, ros_session(auv.port) as other:
                mission, said = Node(other, "mission"), [False, True]

                def abort(_: dict[str, Any]) -> dict[str, Any]:
                    return {"success": said.pop(0), "message": "in the net"}

                mission.serve("/auv1/abort", TRIGGER, abort)
                with started(session) as (_, logged):
                    await until(lambda: states(auv)[-1:] == ["acted"], auv.changed)
                    assert said == []
                    assert any("in the net; asked again" in each for each in logged)

    run(scene())


def test_a_mission_that_listens_to_a_topic_hears_it() -> None:
    async def scene() -> None:
        async with local_network(2, Channel(), section=section()) as auv:
            with ros_session(auv.port) as session, ros_session(auv.port) as other:
                given = {
                    "abort_service": "", "abort_topic": "mission", "abort_value": "{data: abort}",
                    "abort_type": "std_msgs/msg/String",
                }  # fmt: skip
                with started(session, **given) as (_, logged):
                    await asked("nobody subscribes", logged, auv)
                    assert "unanswered" in states(auv)
                    mission = Node(other, "mission")
                    heard = mission.subscribe("/auv1/mission", given["abort_type"])
                    await until(lambda: states(auv)[-1:] == ["acted"], auv.changed)
                    message, _ = await heard.next()
                    assert message == {"data": "abort"}

    run(scene())


def test_it_sees_the_gateway_in_the_graph_and_acts_when_that_is_gone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]

    async def scene() -> None:
        module = importlib.import_module("zacoustic_bringup.lost_contact")
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now[0]))
        with zenoh_router() as port, ros_session(port) as session:
            async with local_network(2, Channel(), section=section(), join=port) as auv:
                with started(session) as (node, logged):
                    (look,) = node.timers
                    # by the gateway, whose crew is lost
                    await asked("nobody serves /auv1/abort", logged, auv)
                    assert len({*logged}) == 1
                    now[0] = 1000.0
                    look()
                    assert len({*logged}) == 1
            logged.clear()
            now[0] = 1119.0
            look()
            assert logged == []
            now[0] = 1120.0
            look()
            (line,) = logged
            assert line.startswith("/acoustic_gateway_2: the gateway has been gone for 120 s")
            assert "nobody serves /auv1/abort" in line

    run(scene())


def test_a_wrong_value_is_refused_at_the_start() -> None:
    async def scene() -> None:
        async with local_network(2, Channel(), section=section()) as auv:
            with ros_session(auv.port) as session:
                with pytest.raises(AttributeError), started(session, abort_value="{date: 1}"):
                    pass
                with (
                    pytest.raises(ValueError, match="one of them"),
                    started(session, abort_topic="x"),
                ):
                    pass

    run(scene())
