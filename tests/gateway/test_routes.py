"""Three gateways in processes of their own: the first and the last reach each other by the second.

Plain Zenoh programs are at both ends; the relay is killed and started again.
"""

import json
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final

import zenoh

from tests.gateway.networks import free_port, get, hear, matched, run, zenoh_config, zenoh_settings
from tests.gateway.test_command import notice, running

SCENARIO: Final = """{
  seed: 7, profile: "ideal", channel: "none",
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [1, 0, 10] },
           { address: 3, position: [2, 0, 10] } ],
  links: [ { from: 1, to: 3, loss: { frame: 1 } }, { from: 3, to: 1, loss: { frame: 1 } } ],
}"""
ENDS: Final = (1, 3)
SECTION: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [{"address": each, "name": f"n{each}"} for each in (1, 2, 3)],
    # As short as this medium allows, so that what a dead relay has lost is repeated soon.
    "routes": [{"id": 1, "name": "far", "path": [1, 2, 3], "lifetime_s": 2}],
    "streams": [
        {"id": 1, "topic": "auv/nav", "publishers": [3], "subscribers": [1], "link": "far"},
        {
            "id": 2,
            "topic": "auv/plan",
            "publishers": [1],
            "subscribers": [3],
            "reliability": "reliable",
            "depth": 10,
            "link": "far",
        },
        {"id": 3, "service": "auv/arm", "server": 3, "link": "far"},
    ],
}


def _write(path: Path, **endpoints: int) -> Path:
    settings = json.loads(zenoh_settings("router", **endpoints))
    settings["plugins_loading"] = {"enabled": False}
    settings["plugins"] = {"acoustic": {"__required__": False, **SECTION}}
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


def _arm(query: zenoh.Query) -> None:
    assert query.payload is not None
    query.reply("auv/arm", b"armed " + query.payload.to_bytes())


def test_programs_beyond_a_relay_that_is_killed_and_started(tmp_path: Path) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            scenario = tmp_path / "line.json5"
            scenario.write_text(SCENARIO, encoding="utf-8")
            medium = await stack.enter_async_context(
                running("run", "medium", scenario, "--listen", "127.0.0.1:0", "--json")
            )
            link = "sim/" + (await notice(medium, "listening"))["address"]
            ports = {each: free_port() for each in (1, 2, 3)}
            files = {
                each: _write(tmp_path / f"{each}.json5", listen=port)
                for each, port in ports.items()
            }

            async def gateway(address: int) -> Any:
                process = await stack.enter_async_context(
                    running(
                        *("run", "gateway", files[address], "--address", address),
                        *("--link", link, "--json"),
                    )
                )
                await notice(process, "started")
                return process

            processes = {each: await gateway(each) for each in (1, 2, 3)}
            shore, auv = (
                stack.enter_context(zenoh.open(zenoh_config("client", connect=ports[each])))
                for each in ENDS
            )
            nav, plan = await hear(shore, "auv/nav"), await hear(auv, "auv/plan")
            for session, key in ((auv, "auv/nav"), (shore, "auv/plan")):
                await matched(session, key)
            stack.enter_context(auv.declare_queryable("auv/arm", _arm))
            auv.put("auv/nav", b"by two hops")
            assert await nav.payload() == b"by two hops"
            shore.put("auv/plan", b"first")
            assert await plan.payload() == b"first"
            replies = await get(shore, "auv/arm", b"now")
            assert replies.payload("auv/arm") == b"armed now"

            processes[2].kill()
            await processes[2].wait()
            shore.put("auv/plan", b"while the relay is dead")
            await gateway(2)
            assert await plan.payload() == b"while the relay is dead"
            replies = await get(shore, "auv/arm", b"again")
            assert replies.payload("auv/arm") == b"armed again"

            about = "@acoustic/1/route/far"
            document = json.loads((await get(shore, about)).payload(about))
            assert (document["link_state"], document["path"]) == ("up", [1, 2, 3])
            assert document["frames_received"] > 0

    run(main())
