"""`zacoustic acl`: a router with what it prints, and programs that try what they may not do."""

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.gateway.certificates import Authority
from tests.gateway.networks import (
    LIMIT_S,
    SECTION,
    Channel,
    Heard,
    cbor,
    config_of,
    free_port,
    get,
    local_network,
    run,
    zenoh_config,
)
from zacoustic.app.cli import main
from zacoustic.app.tools.security.access.grants import Act, Grant, Role, grants_of
from zacoustic.app.tools.security.access.rules import KnownBy, Names, access_settings
from zacoustic.config import Config
from zacoustic.errors import ConfigError
from zacoustic.gateway import Gateway

_PASSWORDS = {"planner": "p", "console": "c"}
_NAMES = Names(by=KnownBy.USERS, programs=("planner",), operators=("console",))
_KEYS = ("mine/x", "auv1/nav", "auv1/text", "fleet/shore/status", "fleet/auv1/status")


class Guarded:
    """Node 1 with the settings that `acl` prints, and its clients."""

    def __init__(self, port: int) -> None:
        self._port = port

    @contextmanager
    def client(self, user: str) -> Iterator[zenoh.Session]:
        settings = zenoh_config("client", connect=self._port)
        who = {"user": user, "password": _PASSWORDS[user]}
        settings.insert_json5("transport/auth/usrpwd", json.dumps(who))
        with zenoh.open(settings) as session:
            yield session


@asynccontextmanager
async def guarded(channel: Channel, folder: Path, **more: Any) -> AsyncIterator[Guarded]:
    port = free_port()
    settings = zenoh_config("router", listen=port)
    config = config_of(1, settings, SECTION)
    made = access_settings(config, _NAMES, **more)
    settings.insert_json5("access_control", json.dumps(made["access_control"]))
    (folder / "users.txt").write_text("".join(f"{u}:{p}\n" for u, p in _PASSWORDS.items()))
    users = {"dictionary_file": str(folder / "users.txt")}
    settings.insert_json5("transport/auth/usrpwd", json.dumps(users))
    async with Gateway(config, link=channel.medium.link(1)):
        yield Guarded(port)


async def _settled(session: zenoh.Session) -> None:
    """Wait until the router has taken in all that a client has declared and put."""
    assert (await get(session, "@acoustic/1/node")).good


def _heard(heard: Heard) -> list[tuple[str, bytes]]:
    return [(str(sample.key_expr), sample.payload.to_bytes()) for sample in heard.samples]


def test_a_program_publishes_its_own_topics_and_nobody_elses(tmp_path: Path) -> None:
    async def scene() -> None:
        channel = Channel()
        async with (
            guarded(channel, tmp_path, opened=("mine/**",)) as here,
            local_network(2, channel) as beyond,
        ):
            with (
                here.client("planner") as program,
                here.client("console") as other,
                beyond.client() as remote,
            ):
                heard = {key: Heard(other, key) for key in _KEYS}
                wide = Heard(other, "**")
                crossed = Heard(remote, "auv1/text")
                await _settled(other)
                for key in _KEYS:
                    program.put(key, b"forged" if "auv1/nav" in key else b"text")
                for wide_key in ("fleet/*/status", "auv1/*", "**"):
                    program.put(wide_key, b"to all")
                program.put("elsewhere", b"text")
                await _settled(program)
                program.put("mine/x", b"end")
                while (await heard["mine/x"].next()).payload.to_bytes() != b"end":
                    pass
                may = {"mine/x", "auv1/text", "fleet/shore/status"}
                assert {key for key, each in heard.items() if each.samples} == may
                assert _heard(heard["fleet/shore/status"]) == [("fleet/shore/status", b"text")]
                # Of what it may not subscribe to, nothing comes by the wider expression.
                assert {key for key, _ in _heard(wide)} <= may
                assert await crossed.payload() == b"text"
                remote.put("auv1/nav", cbor(depth=3.5, mode="survey"))
                assert (await heard["auv1/nav"].next()).payload.to_bytes() == cbor(
                    depth=3.5, mode="survey"
                )

    run(scene())


def test_a_program_calls_what_the_gateway_serves_and_cannot_serve_it(tmp_path: Path) -> None:
    async def scene() -> None:
        channel = Channel()
        async with guarded(channel, tmp_path) as here, local_network(2, channel) as beyond:
            with (
                here.client("planner") as program,
                here.client("console") as other,
                beyond.client() as remote,
            ):
                answered = asyncio.Event()
                loop = asyncio.get_running_loop()

                def impostor(query: zenoh.Query) -> None:
                    query.reply(query.key_expr, b"impostor")

                def serve(query: zenoh.Query) -> None:
                    query.reply(query.key_expr, b"echo")
                    loop.call_soon_threadsafe(answered.set)

                program.declare_queryable("auv1/echo", impostor)
                program.declare_queryable("@acoustic/2/node", impostor)
                remote.declare_queryable("auv1/echo", serve)
                assert (await get(remote, "auv1/echo")).good
                await _settled(program)
                replies = await get(other, "auv1/echo", b"hello")
                assert replies.payload("auv1/echo") == b"echo"
                assert len(replies.good) == 1
                async with asyncio.timeout(LIMIT_S):
                    await answered.wait()
                assert not (await get(other, "@acoustic/2/node")).good

    run(scene())


def test_only_an_operator_commands(tmp_path: Path) -> None:
    async def scene() -> None:
        channel = Channel()
        async with guarded(channel, tmp_path) as here:
            with here.client("planner") as program, here.client("console") as operator:
                command = "@acoustic/1/silence?command=begin;for_s=60"
                refused = await get(program, command)
                assert not refused.good
                assert not refused.errors
                assert (await get(program, "@acoustic/1/link")).good
                for selector in ("@acoustic/1/silence", "@acoustic/1/**", "@acoustic/**"):
                    assert not (await get(program, selector)).good, selector
                state = json.loads((await get(operator, command)).payload("@acoustic/1/silence"))
                assert state["silent"] is True
                program.put("@acoustic/1/link", b"forged")
                health = Heard(operator, "@acoustic/1/link")
                await _settled(operator)
                program.put("@acoustic/1/link", b"forged")
                await _settled(program)
                assert b"forged" not in {payload for _, payload in _heard(health)}
                with program.liveliness().declare_token("@acoustic/9/gateway"):
                    await _settled(program)
                    seen = operator.liveliness().get("@acoustic/*/gateway", timeout=LIMIT_S)
                    keys = {str(each.ok.key_expr) for each in seen if each.ok is not None}
                assert keys == {"@acoustic/1/gateway"}

    run(scene())


@pytest.mark.parametrize("key", ["**", "auv1/*", "auv1/nav", "ctd/raw/*", "@acoustic/1/x"])
def test_what_would_let_programs_speak_for_remote_nodes_cannot_be_opened(key: str) -> None:
    """A put on a wider expression reaches the subscribers of a key on which puts are denied."""
    config = config_of(1, zenoh_config("router", listen=7447), SECTION)
    with pytest.raises(ConfigError, match="where gateways alone"):
        access_settings(config, Names(), opened=("mine/**", key))
    with pytest.raises(ConfigError, match="allowed: a key expression of Zenoh"):
        access_settings(config, Names(), opened=("mine//",))


def test_gateways_and_programs_that_cannot_be_told_apart_are_refused() -> None:
    config = config_of(1, zenoh_config("router", listen=7447), SECTION)
    with pytest.raises(ConfigError, match="--gateway without --program; allowed: both"):
        access_settings(config, Names(gateways=("gateway",)))
    client = config_of(1, zenoh_config("client", connect=7447), SECTION)
    with pytest.raises(ConfigError, match='mode: "client", and --gateway is missing'):
        access_settings(client, Names())
    named = access_settings(client, Names(programs=("planner",), gateways=("gateway",)))
    assert {"id": "gateways", "cert_common_names": ["gateway"]} in named["access_control"][
        "subjects"
    ]


def _rules(
    config: Config, permission: str, message: str, *, beside: tuple[int, ...] = ()
) -> set[str]:
    """Return the keys on which programs are allowed, or denied, to send a message."""
    made = access_settings(config, Names(), beside=beside)["access_control"]
    return {
        key
        for rule in made["rules"]
        if rule["id"].startswith("programs") and rule["permission"] == permission
        if message in rule["messages"] and rule["flows"] == ["ingress"]
        for key in rule["key_exprs"]
    }


def test_a_node_beside_is_no_remote_node() -> None:
    config = config_of(1, zenoh_config("router", listen=7447), SECTION)
    assert "auv1/nav" in _rules(config, "deny", "put")
    assert "auv1/nav" in _rules(config, "allow", "put", beside=(2,))
    assert "auv1/nav" not in _rules(config, "deny", "put", beside=(2,))
    assert "auv1/echo" in _rules(config, "allow", "declare_queryable", beside=(2,))


def test_gateway_may_act_at_lost_contact_and_programs_may_serve_it() -> None:
    entry = {"lost_after_s": 60, "by": 1}
    section = SECTION | {
        "lost_contact": [
            entry | {"name": "up", "call": "shore/alarm"},
            entry | {"name": "slow", "publish": "shore/light"},
        ]
    }
    grants = grants_of(config_of(1, zenoh_config("router", listen=7447), section))
    wanted = (
        Grant(Role.GATEWAY, Act.ASK, "shore/alarm"),
        Grant(Role.PROGRAM, Act.ANSWER, "shore/alarm"),
        Grant(Role.GATEWAY, Act.PUBLISH, "shore/light"),
        Grant(Role.PROGRAM, Act.PUBLISH, "shore/light"),
        Grant(Role.PROGRAM, Act.SUBSCRIBE, "shore/light"),
        Grant(Role.PROGRAM, Act.ASK, "@acoustic/*/contact/*"),
    )
    assert set(wanted) <= set(grants)


def test_streams_of_ros_have_the_keys_and_tokens_of_rmw_zenoh() -> None:
    text = {"type": "std_msgs/msg/String", "ros": {}}
    streams: list[dict[str, Any]] = [
        {"id": 1, "topic": "/auv1/text", **text, "publishers": [2]},
        {"id": 2, "service": "/auv1/go", "type": "std_srvs/srv/Trigger", "ros": {}, "server": 2},
        {"id": 3, "topic": "/shore/text", **text, "publishers": [1]},
    ]
    section = SECTION | {"streams": streams, "types": [], "ros": {"domain": 5}}
    config = config_of(1, zenoh_config("router", listen=7447), section)
    denied, allowed = _rules(config, "deny", "put"), _rules(config, "allow", "put")
    assert any(key.startswith("5/auv1/text/std_msgs::msg::dds_::String_/RIHS01_") for key in denied)
    assert any(key.startswith("5/shore/text/std_msgs::msg::dds_::String_/") for key in allowed)
    served = _rules(config, "deny", "declare_queryable")
    assert any(key.startswith("5/auv1/go/std_srvs::srv::dds_::Trigger_/") for key in served)
    assert _rules(config, "allow", "liveliness_token") >= {"@ros2_lv/5/**"}
    assert "@ros2_lv/*/*/*/*/*/%acoustic/**" in _rules(config, "deny", "liveliness_token")
    own = {key for key in allowed if key.endswith("/@adv/**")}
    assert any(key.startswith("5/shore/text/") for key in own), "its cache for late subscribers"


@pytest.mark.parametrize("by", ["certificates", "users", "interfaces"])
def test_what_is_printed_is_taken_by_zenoh(
    by: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "router.json5"
    path.write_text(json.dumps({"mode": "router", "plugins": {"acoustic": SECTION}}))
    command = ["acl", str(path), "--by", by, "--program", "lo", "--operator", "eth0"]
    assert main(command) == 0
    text = capsys.readouterr().out
    settings = zenoh.Config.from_json5(text)
    made = json.loads(settings.get_json("access_control"))
    assert made["enabled"] is True
    assert made["default_permission"] == "deny"
    assert {each["id"] for each in made["subjects"]} == {"programs", "operators"}
    tls = json.loads(settings.get_json("transport/link/tls"))
    assert tls["enable_mtls"] is (True if by == "certificates" else None)
    assert main([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads(text.partition("\n")[2])


def test_programs_are_known_by_their_certificates(tmp_path: Path) -> None:
    authority, port = Authority(tmp_path), free_port()
    names = Names(programs=("planner",), operators=("console",))

    def client(name: str) -> zenoh.Session:
        settings = zenoh_config("client", connect=port)
        settings.insert_json5("connect/endpoints", f'["tls/127.0.0.1:{port}"]')
        certificate, key = authority.issue(name)
        tls = {
            "root_ca_certificate": str(authority.path),
            "connect_certificate": str(certificate),
            "connect_private_key": str(key),
            "enable_mtls": True,
        }
        settings.insert_json5("transport/link/tls", json.dumps(tls))
        return zenoh.open(settings)

    async def scene() -> None:
        settings = zenoh_config("router", listen=port)
        settings.insert_json5("listen/endpoints", f'["tls/127.0.0.1:{port}"]')
        config = config_of(1, settings, SECTION)
        made = access_settings(config, names)
        certificate, key = authority.issue("router")
        files = {
            "root_ca_certificate": authority.path,
            "listen_certificate": certificate,
            "listen_private_key": key,
        }
        printed = made["transport"]["link"]["tls"]
        assert {printed[each] for each in files} == {"ca.pem", "router.pem", "router.key"}
        tls = {each: str(files.get(each, value)) for each, value in printed.items()}
        tls["enable_mtls"] = printed["enable_mtls"]
        settings.insert_json5("transport/link/tls", json.dumps(tls))
        settings.insert_json5("access_control", json.dumps(made["access_control"]))
        channel = Channel()
        async with Gateway(config, link=channel.medium.link(1)):
            with client("planner") as program, client("console") as operator:
                heard = Heard(operator, "auv1/text")
                await _settled(operator)
                program.put("auv1/nav", b"forged")
                program.put("auv1/text", b"text")
                assert await heard.payload() == b"text"
                command = "@acoustic/1/silence?command=begin;for_s=60"
                assert not (await get(program, command)).good
                assert (await get(operator, command)).good
            with client("stranger") as stranger:
                assert not (await get(stranger, "@acoustic/1/node")).good

    run(scene())
