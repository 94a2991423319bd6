"""Three gateways in processes of their own: by radio straight, else by sound over the second.

The list of the two ends is a UDP link and a route over simulated sound. The radio goes, the relay
is killed and started, the radio comes back; plain Zenoh programs at both ends know of nothing.
"""

import asyncio
import contextlib
import json
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final

import pytest
import zenoh

from tests.gateway.networks import free_port, get, hear, matched, run, zenoh_config, zenoh_settings
from tests.gateway.test_bonds import Air, udp_port
from tests.gateway.test_command import notice, running
from tests.gateway.test_routes import SCENARIO

SHORE, BUOY, AUV = 1, 2, 3
STREAMS: Final[list[dict[str, Any]]] = [
    {"id": 1, "topic": "auv/log", "publishers": [AUV], "subscribers": [SHORE],
     "reliability": "reliable", "depth": 50},
    {"id": 2, "service": "auv/arm", "server": AUV},
]  # fmt: skip


def _write(path: Path, address: int, links: list[dict[str, Any]], listen: int) -> Path:
    settings = json.loads(zenoh_settings("router", listen=listen))
    section = {
        "address": address,
        "nodes": [{"address": each, "name": f"n{each}"} for each in (SHORE, BUOY, AUV)],
        "links": links,
        "routes": [{"id": 1, "name": "far", "path": [SHORE, BUOY, AUV], "lifetime_s": 2}],
        "default_links": ["radio", "far"],
        "streams": STREAMS,
    }
    settings["plugins"] = {"acoustic": section}
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


@pytest.mark.soak
def test_a_log_and_calls_pass_a_radio_that_goes_and_a_relay_that_is_killed(tmp_path: Path) -> None:
    ran: list[bytes] = []

    def arm(query: zenoh.Query) -> None:
        assert query.payload is not None
        ran.append(query.payload.to_bytes())
        query.reply("auv/arm", b"armed " + ran[-1])

    async def main() -> None:
        async with AsyncExitStack() as stack:
            scenario = tmp_path / "scenario.json5"
            scenario.write_text(SCENARIO, encoding="utf-8")
            medium = await stack.enter_async_context(
                running("run", "medium", scenario, "--listen", "127.0.0.1:0", "--json")
            )
            sound: dict[str, Any] = {
                "name": "sound",
                "locator": f"sim/{(await notice(medium, 'listening'))['address']}",
            }
            air = {SHORE: Air(), AUV: Air()}
            aerials = {each: udp_port() for each in air}
            of_ends: dict[str, Any] = {
                "name": "radio",
                "cost": "free",
                "down_after_s": 1,
                "owners": [SHORE, AUV],
            }
            links: dict[int, list[dict[str, Any]]] = {
                BUOY: [sound, of_ends | {"locator": "udp/127.0.0.1:1#peers=127.0.0.1:1"}]
            }
            for here, there in ((SHORE, AUV), (AUV, SHORE)):
                place, _ = await asyncio.get_running_loop().create_datagram_endpoint(
                    lambda here=here: air[here],  # type: ignore[misc]
                    local_addr=("127.0.0.1", 0),
                )
                stack.callback(place.close)
                air[here].other = ("127.0.0.1", aerials[there])
                port = place.get_extra_info("sockname")[1]
                radio = f"udp/127.0.0.1:{aerials[here]}#peers=127.0.0.1:{port}"
                links[here] = [sound, of_ends | {"locator": radio}]
            ports = {each: free_port() for each in links}

            async def gateway(address: int) -> Any:
                file = tmp_path / f"{address}.json5"
                _write(file, address, links[address], ports[address])
                process = await stack.enter_async_context(running("run", "gateway", file, "--json"))
                await notice(process, "started")
                return process

            processes = {each: await gateway(each) for each in links}
            shore, auv = (
                stack.enter_context(zenoh.open(zenoh_config("client", connect=ports[each])))
                for each in (SHORE, AUV)
            )
            log = await hear(shore, "auv/log")
            await matched(auv, "auv/log")
            stack.enter_context(auv.declare_queryable("auv/arm", arm))
            given: list[bytes] = []

            async def report() -> None:
                given.append(b"%d" % len(given))
                auv.put("auv/log", given[-1])
                while len(log.samples) < len(given):  # half a minute, where a relay had died
                    with contextlib.suppress(TimeoutError):
                        await log.next()

            while await _in_use(auv) != "radio":
                await report()
            for each in air.values():
                each.is_up = False  # the vehicle dives
            while await _in_use(auv) != "far":
                await report()
            replies = await get(shore, "auv/arm", b"over the relay")
            assert replies.payload("auv/arm") == b"armed over the relay"
            processes[BUOY].kill()
            await processes[BUOY].wait()
            reported = asyncio.create_task(report())
            called = asyncio.create_task(get(shore, "auv/arm", b"no relay"))
            await gateway(BUOY)
            await reported
            assert (await called).payload("auv/arm") == b"armed no relay"
            for each in air.values():
                each.is_up = True  # and surfaces
            while await _in_use(auv) != "radio":
                await report()
            await report()
            assert [each.payload.to_bytes() for each in log.samples] == given
            assert ran == [b"over the relay", b"no relay"]

    run(main(), limit_s=120.0)


async def _in_use(session: zenoh.Session) -> Any:
    about = f"@acoustic/{AUV}/bond/radio+far"
    return json.loads((await get(session, about)).payload(about))["in_use"]
