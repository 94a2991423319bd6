"""A mooring and a glider with journals: what `status` tells of carried samples, also of the dead.

Their ship is never there.
"""

import json
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.cli.watched import lines_of
from tests.gateway.networkpair import verb
from tests.gateway.networks import (
    Channel,
    LocalNetwork,
    config_of,
    free_port,
    get,
    hear,
    matched,
    run,
    zenoh_config,
)
from zacoustic.gateway import Gateway

MOORING, GLIDER, SHIP = 1, 2, 3


def _section(folder: Path, **carry: Any) -> dict[str, Any]:
    log = {
        "id": 12, "topic": "mooring/log", "publishers": [MOORING], "subscribers": [SHIP],
        "reliability": "reliable", "journal": True, "depth": 9,
        "carry": {"by": [GLIDER], "after_s": 2, **carry},
    }  # fmt: skip
    names = {MOORING: "mooring", GLIDER: "glider", SHIP: "ship"}
    nodes = [{"address": each, "name": name} for each, name in names.items()]
    here = {"id": 1, "topic": "glider/here", "publishers": [GLIDER], "subscribers": [MOORING]}
    return {"address": 1, "nodes": nodes, "streams": [here, log], "journal": str(folder)}


def test_status_tells_who_has_what_for_whom_and_a_journal_what_a_dead_gateway_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    section = _section(tmp_path, expires_s=3600)

    async def main() -> None:
        channel = Channel()
        async with AsyncExitStack() as mooring_runs:
            places = {each: LocalNetwork(free_port()) for each in (MOORING, GLIDER)}
            where = {
                each: ("--connect", f"tcp/127.0.0.1:{place.port}") for each, place in places.items()
            }
            async with AsyncExitStack() as glider_runs:
                stacks = {MOORING: mooring_runs, GLIDER: glider_runs}
                for each, place in places.items():
                    config = config_of(each, zenoh_config("router", listen=place.port), section)
                    link = channel.medium.link(each)
                    gateway = Gateway(config, link=link, notify=place.notify)
                    await stacks[each].enter_async_context(gateway)
                at_mooring = mooring_runs.enter_context(places[MOORING].client())
                await _meet(at_mooring, places[GLIDER])
                for number in range(3):
                    at_mooring.put("mooring/log", b"%d" % number)
                await _told(places[MOORING], 3)

                assert await verb("status", *where[MOORING]) == 0
                lines = capsys.readouterr().out.splitlines()
                first = next(at for at, line in enumerate(lines) if "carried" in line)
                assert lines[first] == "  carried  mooring/log: 3 for 3 wait"
                assert lines[first + 2].endswith(" s, first expires in 60 min")
                assert lines[first + 1].startswith(
                    "           3 of them in custody of 2 glider, heard "
                )
                assert await verb("status", *where[GLIDER], "--json") == 0
                (status,) = lines_of(capsys)
                (of_log,) = status["carry"]["streams"]
                assert (of_log["own"], of_log["carried"]) == ({}, {"3": 3})
                assert status["carry"]["carried_bytes"] == of_log["carried_bytes"] > 0
                # On the channel a life is 4 bits of mantissa.
                assert 3300 < of_log["ends_in_s"] <= 3600
                assert of_log["oldest_s"] < 60
            # Nobody answers for the glider now. The mooring still names it, and its journal tells.
            assert await verb("status", *where[MOORING], "--json") == 0
            (status,) = lines_of(capsys)
            assert status["carry"]["streams"][0]["custodians"] == {"2": 3}
            assert await verb("status", *where[GLIDER]) != 0
            capsys.readouterr()
            assert await verb("journal", "check", str(tmp_path / "node-2.sqlite")) == 0
            assert "carried, stream 12: of others 3 for 3" in capsys.readouterr().out.splitlines()
            assert await verb("journal", "check", str(tmp_path / "node-1.sqlite")) == 0
            said = "carried, stream 12: 3 for 3, 3 of them in custody of 2"
            assert said in capsys.readouterr().out.splitlines()

    run(main())


def test_custodian_without_room_is_in_the_status_of_both(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    section = _section(tmp_path) | {"carry": {"max_bytes": 20}}

    async def main() -> None:
        channel = Channel()
        async with AsyncExitStack() as stack:
            places = {each: LocalNetwork(free_port()) for each in (MOORING, GLIDER)}
            for each, place in places.items():
                config = config_of(each, zenoh_config("router", listen=place.port), section)
                gateway = Gateway(config, link=channel.medium.link(each), notify=place.notify)
                await stack.enter_async_context(gateway)
            at_mooring = stack.enter_context(places[MOORING].client())
            await _meet(at_mooring, places[GLIDER])
            at_mooring.put("mooring/log", bytes(100))
            await _told(places[MOORING], 2)  # it took it, before it knew that it has no room
            assert places[MOORING].notices[-1].record() == {
                "event": "custody", "stream": "mooring/log", "subscriber": SHIP, "custodian": None,
                "detail": "node 2 has no room for it",
            }  # fmt: skip
            assert await verb("status", "--connect", f"tcp/127.0.0.1:{places[GLIDER].port}") == 0
            out = capsys.readouterr().out
            assert "  custody  for others 0 B of 20 B; 1 refused, no room" in out.splitlines()
            about = f"@acoustic/{MOORING}/carry"
            document = json.loads((await get(at_mooring, about)).payload(about))
            assert (document["own"], document["in_custody"]) == (1, 0)

    run(main())


async def _meet(at_mooring: zenoh.Session, glider: LocalNetwork) -> None:
    """Let the mooring hear the glider: it calls out to one that it has not heard in turns."""
    here = await hear(at_mooring, "glider/here")
    with glider.client() as at_glider:
        await matched(at_glider, "glider/here")
        at_glider.put("glider/here", b"")
        await here.next()
    await matched(at_mooring, "mooring/log")


async def _told(place: LocalNetwork, count: int) -> None:
    """Wait until the mooring has told who has its samples, or that none has, so many times."""
    while len(place.told("custody")) < count:
        place.changed.clear()
        await place.changed.wait()
