"""Where a gateway listens whose file says nothing of it: on this computer only, and it says so."""

import os
import sys
from pathlib import Path
from typing import Final

import msgspec
import pytest
import zenoh

from tests.gateway.networks import SECTION, Channel, LocalNetwork, config_of, free_port, run
from zacoustic.config import config_from_mapping
from zacoustic.gateway import Gateway
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.session.session import endpoints_of, listen_here

SILENT: Final = "{ mode: '%s', scouting: { multicast: { enabled: false } } }"


def listening() -> set[str]:
    """Return where this process listens, as the kernel has it: addresses in hexadecimal."""
    own = set()
    for entry in Path("/proc/self/fd").iterdir():
        try:
            own.add(os.readlink(entry))
        except OSError:  # the descriptor of this very listing
            continue
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/self/net/{table}").read_text().splitlines()[1:]:
            cells = line.split()
            if cells[3] == "0A" and f"socket:[{cells[9]}]" in own:
                found.add(cells[1])
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="asks the kernel of Linux")
def test_a_file_without_listen_is_reached_from_this_computer_only() -> None:
    async def scene() -> None:
        before = listening()
        found = LocalNetwork(0)
        config = config_of(1, zenoh.Config.from_json5(SILENT % "peer"))
        async with Gateway(config, link=Channel().medium.link(1), notify=found.notify):
            opened = {place.rpartition(":")[0] for place in listening() - before}
            assert opened == {"0100007F"}  # 127.0.0.1
        (started,) = found.told("started")
        assert started.facts["listens_here"]
        assert started.facts["endpoints"] == ("listen tcp/127.0.0.1:0",)
        assert any("only this computer" in line for line in started.lines())

    run(scene())


def test_router_and_the_nodes_of_its_file_meet_on_the_loopback() -> None:
    settings = zenoh.Config.from_json5(SILENT % "router")
    assert listen_here(settings)
    assert endpoints_of(settings, "listen") == ("tcp/127.0.0.1:7447",)
    config = config_from_mapping(SECTION, source="test")
    config = msgspec.structs.replace(
        config, zenoh_config=zenoh.Config.from_json5(SILENT % "router")
    )
    assert endpoints_of(session_config(config, None), "connect") == ("tcp/127.0.0.1:7447",)


@pytest.mark.parametrize("mode", ["router", "peer"])
def test_a_file_that_says_where_is_followed(mode: str) -> None:
    place = f"tcp/0.0.0.0:{free_port()}"
    text = (SILENT % mode)[:-1] + f", listen: {{ endpoints: ['{place}'] }} }}"
    settings = zenoh.Config.from_json5(text)
    assert not listen_here(settings)
    assert endpoints_of(settings, "listen") == (place,)


def test_a_client_listens_nowhere() -> None:
    assert not listen_here(zenoh.Config.from_json5(SILENT % "client"))
