"""Start, errors of starting, a router that goes and comes, and the end."""

import asyncio
import threading

import pytest
import zenoh

from tests.gateway.networks import (
    LIMIT_S,
    TABLE,
    Channel,
    cbor,
    config_of,
    free_port,
    get,
    hear,
    local_network,
    matched,
    run,
    until,
    zenoh_config,
)
from zacoustic.errors import ConfigError, LinkOpenError, LocalError, SessionError
from zacoustic.gateway import Gateway, Notice
from zacoustic.zenoh.session.session import endpoints_of, mode_of


def test_port_in_use_is_one_line_with_endpoint_and_advice() -> None:
    async def main() -> None:
        channel = Channel()
        async with local_network(1, channel) as a:
            config = config_of(2, zenoh_config("router", listen=a.port))
            with pytest.raises(SessionError) as caught:
                await Gateway(config, link=channel.medium.link(2)).start()
        text = str(caught.value)
        assert text.startswith(f"cannot listen on tcp/127.0.0.1:{a.port}: Address already in use (")
        assert "\n" not in text
        assert ".rs" not in text

    run(main())


def test_unreachable_router_is_one_line_with_endpoint_and_advice() -> None:
    port = free_port()

    async def main() -> None:
        config = config_of(2, zenoh_config("client", connect=port))
        with pytest.raises(SessionError, match=f"no Zenoh router at tcp/127.0.0.1:{port} "):
            await Gateway(config, link=Channel().medium.link(2)).start()

    run(main())


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ('{ mode: "client" }', "mode client without a router"),
        ('{ listen: { endpoints: ["serial//dev/ttyX"] } }', "no serial connections"),
        ('{ listen: { endpoints: ["tcp/192.0.2.1:7"] } }', "no such address"),
    ],
)
def test_other_errors_of_a_session_say_what_to_change(settings: str, expected: str) -> None:
    async def main() -> None:
        config = zenoh.Config.from_json5(settings)
        config.insert_json5("scouting/multicast/enabled", "false")
        with pytest.raises(SessionError, match=expected):
            await Gateway(config_of(2, config), link=Channel().medium.link(2)).start()

    run(main())


def test_failure_of_the_link_leaves_nothing_open() -> None:
    async def main() -> None:
        channel, port = Channel(), free_port()
        for _ in range(2):  # the second finds the port free again
            config = config_of(2, zenoh_config("router", listen=port))
            with pytest.raises(LinkOpenError, match="no node 9"):
                await Gateway(config, link=channel.medium.link(9)).start()

    run(main())


def test_config_without_session_or_link_is_refused() -> None:
    async def main() -> None:
        with pytest.raises(ConfigError, match="names no modem"):
            Gateway(config_of(1, zenoh_config("peer")))
        without: object = None
        with pytest.raises(ConfigError, match="no Zenoh settings"):
            Gateway(config_of(1, without), link=Channel().medium.link(1))  # type: ignore[arg-type]

    run(main())


def test_start_that_is_cancelled_leaves_nothing_open() -> None:
    async def main() -> None:
        channel, port = Channel(), free_port()
        settings = zenoh_config("router", listen=port)
        settings.insert_json5("scouting/delay", "200")  # opening takes this long, ms
        starting = asyncio.ensure_future(
            Gateway(config_of(2, settings), link=channel.medium.link(2)).start()
        )
        await asyncio.wait({starting}, timeout=0.01)
        starting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await starting

    run(main())


def test_gateway_says_what_it_is_and_that_it_ends() -> None:
    async def main() -> None:
        notices: list[Notice] = []
        port = free_port()
        config = config_of(2, zenoh_config("router", listen=port))
        gateway = Gateway(config, link=Channel().medium.link(2), notify=notices.append)
        async with gateway:
            started = notices[-1]
            assert started.event == "started"
            facts = started.facts
            assert (facts["address"], facts["name"], facts["mode"]) == (2, "auv1", "router")
            assert facts["endpoints"] == (f"listen tcp/127.0.0.1:{port}",)
            assert facts["digest"] == config.table.digest.hex()
            assert started.lines()[0] == "address   2 auv1"
            ended = asyncio.ensure_future(gateway.wait_failed())
        await ended
        await gateway.close()
        assert (notices[-1].event, notices[-1].lines()) == ("stopped", ["stopped"])
        assert sum(notice.event == "stopped" for notice in notices) == 1

    run(main())


def test_fault_of_the_link_comes_out_and_the_gateway_closes() -> None:
    async def main() -> None:
        channel = Channel()
        link = channel.medium.link(1)

        def broken(_: object) -> None:
            raise ZeroDivisionError("a bug in a driver")

        link.transmit = broken  # type: ignore[method-assign,assignment]
        port = free_port()
        config = config_of(1, zenoh_config("router", listen=port))
        async with Gateway(config, link=link, notify=lambda _: None) as gateway:
            with zenoh.open(zenoh_config("client", connect=port)) as client:
                await matched(client, "chat")
                client.put("chat", b"x")
                with pytest.raises(ZeroDivisionError):
                    await gateway.wait_failed()

    run(main())


def test_client_of_a_router_is_back_by_itself_after_the_router_restarts() -> None:
    async def main() -> None:
        channel, port = Channel(), free_port()
        router = zenoh.open(zenoh_config("router", listen=port))
        try:
            async with local_network(1, channel, join=port) as a, local_network(2, channel) as b:
                router.close()  # type: ignore[no-untyped-call]
                router = zenoh.open(zenoh_config("router", listen=port))
                with zenoh.open(zenoh_config("client", connect=port)) as shore, b.client() as auv:
                    await matched(shore, "chat")
                    await matched(auv, "chat")
                    at_shore, at_auv = await hear(shore, "chat"), await hear(auv, "chat")
                    shore.put("chat", b"there")
                    assert await at_auv.payload() == b"there"
                    auv.put("chat", b"back")
                    assert await at_shore.payload() == b"there"
                    assert await at_shore.payload() == b"back"
                    assert "@acoustic/1/link" in (await get(shore, "@acoustic/**")).good
                    tokens = shore.liveliness().get("@acoustic/*/gateway/**", timeout=LIMIT_S)
                    keys = [str(reply.ok.key_expr) for reply in tokens if reply.ok is not None]
                    token = "@acoustic/1/gateway"
                    assert sorted(keys) == [token, f"{token}/{TABLE.digest.hex()}"]
                    replies = await get(shore, "auv1/arm", cbor(arm=True))
                    assert len(replies.errors) == 1
                    assert "NO_SERVER" in replies.errors[0]
                said = [each.facts["state"] for each in a.told("router")]
                assert said == ["lost", "back"]
                assert not b.told("router")
        finally:
            router.close()  # type: ignore[no-untyped-call]

    run(main())


def test_mode_and_endpoints_are_read_from_any_form_of_the_config() -> None:
    text = (
        '{ mode: "client", connect: { endpoints: { client: ["tcp/h:1"], router: ["tcp/r:1"] } } }'
    )
    config = zenoh.Config.from_json5(text)
    assert (mode_of(config), endpoints_of(config, "connect")) == ("client", ("tcp/h:1",))
    assert mode_of(zenoh.Config()) == "peer"


def test_threads_of_a_closed_gateway_are_gone() -> None:
    before = set(threading.enumerate())

    async def main() -> None:
        channel = Channel()
        async with local_network(1, channel) as a:
            await until(lambda: a.notices, a.changed)

    run(main())
    left = {thread for thread in threading.enumerate() if thread not in before}
    for thread in left:
        thread.join(LIMIT_S)
    assert not [thread for thread in left if thread.is_alive()]


def test_gateway_that_was_not_started_has_no_end_to_wait_for() -> None:
    async def main() -> None:
        config = config_of(1, zenoh_config("router", listen=free_port()))
        never = Gateway(config, link=Channel().medium.link(1))
        with pytest.raises(LocalError, match="has not been started"):
            await never.wait_failed()
        await never.close()

    run(main())
