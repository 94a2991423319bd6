"""Two gateways in processes of their own, with radio and sound: the radio comes and goes.

Plain Zenoh programs are at both ends. The datagrams pass a place between, which drops them while
the vehicle is below.
"""

import asyncio
import json
import socket
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final

import zenoh

from tests.gateway.networks import free_port, get, hear, matched, run, zenoh_config, zenoh_settings
from tests.gateway.test_command import notice, running

SCENARIO: Final = """{
  seed: 7, profile: "ideal", channel: "none",
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [100, 0, 10] } ],
}"""


class Air(asyncio.DatagramProtocol):
    """What is between the two aerials."""

    def __init__(self) -> None:
        self.is_up = True
        self.passed = 0
        self.other: tuple[str, int] = ("", 0)
        self._transport: Any = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        """Pass on a datagram."""
        if self.is_up:
            self.passed += 1
            self._transport.sendto(data, self.other)


def udp_port() -> int:
    """Return a port for datagrams that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def _write(path: Path, address: int, links: list[dict[str, Any]], listen: int) -> Path:
    settings = json.loads(zenoh_settings("router", listen=listen))
    settings["plugins_loading"] = {"enabled": False}
    section = {
        "address": address,
        "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv"}],
        "links": links,
        "default_links": ["radio", "acoustic"],
        "streams": [
            {"id": 1, "topic": "auv/nav", "publishers": [2], "subscribers": [1]},
            {
                "id": 2,
                "topic": "auv/plan",
                "publishers": [1],
                "subscribers": [2],
                "reliability": "reliable",
                "depth": 10,
            },
            {"id": 3, "service": "auv/arm", "server": 2},
        ],
    }
    settings["plugins"] = {"acoustic": {"__required__": False, **section}}
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


def _arm(query: zenoh.Query) -> None:
    assert query.payload is not None
    query.reply("auv/arm", b"armed " + query.payload.to_bytes())


def test_programs_at_both_ends_know_nothing_of_the_radio(tmp_path: Path) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            scenario = tmp_path / "water.json5"
            scenario.write_text(SCENARIO, encoding="utf-8")
            medium = await stack.enter_async_context(
                running("run", "medium", scenario, "--listen", "127.0.0.1:0", "--json")
            )
            sound = "sim/" + (await notice(medium, "listening"))["address"]
            aerials = {each: udp_port() for each in (1, 2)}
            air: dict[int, Air] = {}
            loop, ports = asyncio.get_running_loop(), {}
            for each in (1, 2):
                transport, air[each] = await loop.create_datagram_endpoint(
                    Air, local_addr=("127.0.0.1", 0)
                )
                stack.callback(transport.close)
                ports[each] = transport.get_extra_info("sockname")[1]
                air[each].other = ("127.0.0.1", aerials[3 - each])
            files, local = {}, {each: free_port() for each in (1, 2)}
            for each in (1, 2):
                radio = f"udp/127.0.0.1:{aerials[each]}#peers=127.0.0.1:{ports[each]}"
                links = [
                    {"name": "acoustic", "locator": sound},
                    {"name": "radio", "locator": radio, "cost": "free", "down_after_s": 1},
                ]
                path = tmp_path / f"{each}.json5"
                files[each] = _write(path, each, links, local[each])
                process = await stack.enter_async_context(
                    running("run", "gateway", files[each], "--json")
                )
                await notice(process, "started")
            shore, auv = (
                stack.enter_context(zenoh.open(zenoh_config("client", connect=local[each])))
                for each in (1, 2)
            )
            nav, plan = await hear(shore, "auv/nav"), await hear(auv, "auv/plan")
            for session, key in ((auv, "auv/nav"), (shore, "auv/plan")):
                await matched(session, key)
            stack.enter_context(auv.declare_queryable("auv/arm", _arm))
            shore.put("auv/plan", b"first")
            assert await plan.payload() == b"first"
            while await _reach(shore) != "up":  # as the health report says, once a second
                shore.put("auv/plan", b"by radio")
                assert await plan.payload() == b"by radio"

            for place in air.values():
                place.is_up = False  # the vehicle dives
            shore.put("auv/plan", b"below")
            assert await plan.payload() == b"below"
            while await _reach(shore) == "up":
                pass
            auv.put("auv/nav", b"by sound")
            assert await nav.payload() == b"by sound"
            replies = await get(shore, "auv/arm", b"now")
            assert replies.payload("auv/arm") == b"armed now"

            for place in air.values():
                place.is_up = True  # and surfaces
            passed = air[1].passed
            while await _reach(shore) != "up":
                auv.put("auv/nav", b"at the surface")
                shore.put("auv/plan", b"at the surface")
                assert await plan.payload() == b"at the surface"
            assert air[1].passed > passed

    run(main())


async def _reach(session: zenoh.Session) -> Any:
    about = "@acoustic/1/bond/radio+acoustic"
    return json.loads((await get(session, about)).payload(about))["reach"]["2"]["radio"]
