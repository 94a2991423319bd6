"""`zacoustic config doctor`: each fault is made for real and named; healthy set-ups stay silent."""

import asyncio
import contextlib
import json
import random
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.gateway.networks import Channel, free_port, get, hear, run, until, zenoh_settings
from tests.links.desert.desert_rig import config as desert_config
from tests.tools.ward import (
    STREAMS,
    TDMA,
    beside,
    examine,
    full_disk,
    gateway,
    link,
    modem_file,
    modems,
    problem,
    time_server,
    unprivileged,
    write,
)
from zacoustic.app.cli import main
from zacoustic.app.tools.field.doctor.host import check_clock, kernel_synchronised
from zacoustic.app.tools.field.doctor.network import Running, look
from zacoustic.app.tools.field.doctor.rosnodes import judge_nodes
from zacoustic.bytestream import ByteStream
from zacoustic.config import read_config
from zacoustic.link import registry
from zacoustic.link.contract import Finding
from zacoustic.testing.linkpair import RecordingReceiver
from zacoustic_desert.channel import SampleChannel
from zacoustic_desert.link import DesertLink
from zacoustic_desert.server import StandInServer
from zacoustic_desert.standin import Observer, StandIn, StandInConfig
from zacoustic_evologics import Interpreter

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals and limits")
SCALE = 50.0
EAGER = [{**STREAMS[0], "min_interval_s": 0}, STREAMS[1]]


def standin(
    nodes: int = 2, *, max_read_length: int = 64, observer: Observer | None = None
) -> StandInServer:
    behind = StandIn(
        SampleChannel(nodes, random.Random(1), half_duplex=False),
        StandInConfig(max_read_length=max_read_length),
        rng=random.Random(1),
        observer=observer,
    )
    return StandInServer(behind, time_scale=SCALE)


@pytest.fixture
def readable() -> Iterator[Path]:
    """A folder that other users can read."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


# Healthy


def test_a_healthy_modem_on_the_network_and_a_journal(tmp_path: Path) -> None:
    async def main() -> None:
        async with modem_file(tmp_path, journal="journal") as path:
            told = await examine(path)
            assert (told.code, told.findings) == (0, []), told

    run(main())
    assert not (tmp_path / "journal").exists()


@pytest.mark.parametrize("interpreter", Interpreter)
def test_a_healthy_modem_on_a_serial_port(tmp_path: Path, interpreter: Interpreter) -> None:
    async def main() -> None:
        async with modems(interpreter=interpreter) as server:
            place = server.open_terminal(1, baudrate=38_400)
            path = write(tmp_path, links=link(f"evologics/{place.locator}#baudrate=38400"))
            told = await examine(path)
            assert (told.code, told.findings) == (0, []), told

    run(main())


def test_a_healthy_desert(tmp_path: Path) -> None:
    async def main() -> None:
        left = asyncio.Event()
        server = standin(observer=lambda it: left.set() if it.event == "left" else None)
        await server.open()
        path = write(tmp_path, links=link(f"desert/{server.addresses[0]}"))
        told = await examine(path)
        await left.wait()
        await server.close()
        assert (told.code, told.findings) == (0, []), told

    run(main())


def test_two_healthy_gateways_that_run(tmp_path: Path) -> None:
    async def main() -> None:
        channel = Channel()
        async with (
            gateway(1, channel.medium.link(1)) as shore,
            gateway(2, channel.medium.link(2)) as auv,
        ):
            with auv.client() as session, shore.client() as other:
                session.put("auv1/nav", b"here")
                other.put("cmd", b"there")
                await until(lambda: channel.sent_by(1) and channel.sent_by(2), channel.changed)
            path = beside(tmp_path, shore, "sim/127.0.0.1:1")
            told = await examine(path)
            assert (told.code, told.findings) == (0, []), told
            assert any("gateway that runs has it" in each for each in told.left_out)

    run(main())


def test_a_healthy_schedule_with_a_right_clock_and_a_router(tmp_path: Path) -> None:
    async def main() -> None:
        channel = Channel()
        async with (
            time_server() as clock,
            gateway(3, channel.medium.link(3), nodes=[], streams=[]) as router,
            modem_file(
                tmp_path, access=TDMA, zenoh=zenoh_settings("client", connect=router.port)
            ) as path,
        ):
            told = await examine(path, "--ntp", clock)
        assert (told.code, told.findings) == (0, []), told

    run(main())


# Faults


def test_a_wrong_baud_rate(tmp_path: Path) -> None:
    async def main() -> None:
        async with modems() as server:
            place = server.open_terminal(1, baudrate=9600)
            path = write(
                tmp_path, links=link(f"evologics/{place.locator}#baudrate=19200&reply_s=0.3")
            )
            told = await problem(path)
        assert "no modem at 19200 baud, one answers at 9600" in told.text
        assert told.findings[0]["cure"] == "baudrate=9600 in the locator"

    run(main())


@pytest.mark.parametrize(
    ("said", "named"),
    [
        (b"AT*SEND,5,2,hello\n", "the modem is in burst mode: AT?S says"),
        (b"ATN\n", "the modem does not listen: AT?S says"),
    ],
)
def test_a_modem_that_another_program_has_put_into_another_state(
    tmp_path: Path, said: bytes, named: str
) -> None:
    async def main() -> None:
        async with modems(settings={"RI": 0}) as server:
            place = await server.listen(1, "127.0.0.1", 0)
            _, host, port = place.locator.split(":")
            reader, writer = await asyncio.open_connection(host, int(port))
            writer.write(said)
            assert (await reader.readline()).startswith((b"OK", b"INITIATION"))
            path = write(tmp_path, links=link(f"evologics/{place.locator}"))
            told = await examine(path)
            writer.close()
        assert told.code == 1
        assert named in told.text

    run(main())


def test_an_address_clash_on_the_channel(tmp_path: Path) -> None:
    async def main() -> None:
        server = standin(3)
        await server.open()
        links = [DesertLink(each, desert_config(SCALE)) for each in server.addresses]
        async with (
            gateway(1, links[0], streams=EAGER),
            gateway(2, links[1], streams=EAGER) as first,
            gateway(2, links[2], streams=EAGER) as second,
        ):
            with second.client() as session, first.client() as watching:
                for number in range(1, 4):
                    session.put("auv1/nav", b"here")
                    await _until_document(watching, 2, "dropped", partial(_has_own, number))
            path = beside(tmp_path, first, f"desert/{server.addresses[1]}", address=2)
            told = await problem(path)
        await server.close()
        assert "address clash" in told.text

    run(main())


def test_an_address_clash_of_modem_and_node(tmp_path: Path) -> None:
    async def main() -> None:
        async with modem_file(tmp_path, {"AL": 2}) as path:
            told = await problem(path)
        assert "the modem has address 2, this node 1" in told.text

    run(main())


def test_a_table_mismatch_between_ends(tmp_path: Path) -> None:
    other = [{**STREAMS[0], "stamp": "age"}, STREAMS[1]]

    async def main() -> None:
        channel = Channel()
        async with (
            gateway(1, channel.medium.link(1)) as shore,
            gateway(2, channel.medium.link(2), streams=other) as auv,
        ):
            with auv.client() as session, shore.client() as watching:
                session.put("auv1/nav", b"here")
                await _until_document(
                    watching, 1, "peers", lambda it: it["2"]["same_table"] is False
                )
            path = beside(tmp_path, shore, "sim/127.0.0.1:1")
            told = await problem(path)
        assert "table mismatch: node 2" in told.text

    run(main())


def test_a_gateway_that_runs_with_another_file(tmp_path: Path) -> None:
    async def main() -> None:
        channel = Channel()
        async with gateway(1, channel.medium.link(1)) as shore:
            path = beside(tmp_path, shore, streams=STREAMS[:1])
            told = await problem(path)
        assert "table mismatch: the gateway that runs has table" in told.text

    run(main())


def test_an_mtu_above_the_read_length_of_desert(tmp_path: Path) -> None:
    async def main() -> None:
        server = standin(max_read_length=64)
        await server.open()
        near, far = (
            DesertLink(each, desert_config(SCALE, max_read_length=256)) for each in server.addresses
        )
        async with (
            gateway(1, near, streams=EAGER) as shore,
            gateway(2, far, streams=EAGER) as auv,
        ):
            with auv.client() as session, shore.client() as watching:
                for number in range(1, 5):
                    session.put("auv1/nav", bytes(150))
                    await _until_document(watching, 1, "link", partial(_has_cut, number))
            path = beside(tmp_path, shore, f"desert/{server.addresses[0]}#max_read_length=256")
            told = await problem(path)
        await server.close()
        assert "frames come in pieces" in told.text
        assert "max_read_length of the link is 256, and they are cut after 64 bytes" in told.text

    run(main())


def test_a_clock_that_is_off_by_more_than_the_schedule_bears(tmp_path: Path) -> None:
    async def main() -> None:
        ahead = time_server(ahead_s=-2.5)
        async with modem_file(tmp_path, access=TDMA) as path, ahead as clock:
            told = await problem(path, "--ntp", clock)
        skew = re.search(r"clock skew: the clock is \+(\S+) s off", told.text)
        assert skew is not None
        assert float(skew[1]) == pytest.approx(2.5, abs=0.5)

    run(main())


def test_desert_that_is_not_started(tmp_path: Path) -> None:
    async def main() -> None:
        path = write(tmp_path, links=link(f"desert/127.0.0.1:{free_port()}"))
        told = await problem(path, "--patience", "0.5")
        assert "DESERT does not answer at 127.0.0.1" in told.text

    run(main())


def test_a_port_that_is_not_deserts(tmp_path: Path) -> None:
    """Its link was up, and the doctor advised a read length that the file refuses."""

    async def main() -> None:
        async def greet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(b"SSH-2.0-OpenSSH_9.2p1\r\n")
            with contextlib.suppress(OSError):
                await reader.read()
            writer.close()

        server = await asyncio.start_server(greet, "127.0.0.1", 0)
        async with server:
            port = server.sockets[0].getsockname()[1]
            path = write(tmp_path, links=link(f"desert/127.0.0.1:{port}"))
            told = await problem(path, "--patience", "3")
        assert "is not DESERT: it says 'SSH-2.0-OpenSSH_9.2p1'" in told.text
        assert "max_read_length" not in told.text

    run(main())


def test_no_read_length_is_advised_that_the_file_refuses() -> None:
    readings = {"pieces": 40, "pieces_cut": 30, "cut_after_bytes": 3, "frames_unheard": 0}
    (found,) = DesertLink("127.0.0.1:4000").assess({"link": {"diagnostics": readings}})
    assert "is not DESERT: pieces of 3 bytes" in found.what
    (found,) = DesertLink("127.0.0.1:4000").assess(
        {"link": {"diagnostics": {**readings, "cut_after_bytes": 32}}}
    )
    assert "max_read_length=32" in found.cure


ROS_TOKEN = "@ros2_lv/{}/ab12/0/1/MP/%/%auv1/{}/%auv1%leak/{}::msg::dds_::{}_/{}/::,10:,:,:,,"
BOOL_HASH = "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9"
LEAK = [{"id": 1, "topic": "/auv1/leak", "type": "std_msgs/msg/Bool", "ros": {}}]


def nodes_found(
    folder: Path, *tokens: str, unmet: tuple[str, ...] = (), distro: str = "jazzy"
) -> list[Finding]:
    path = write(folder, streams=LEAK, ros={"distro": distro, "domain": 0})
    running = Running(is_joined=True, tokens=tokens, unmet=unmet)
    return list(judge_nodes(read_config(path), running))


def test_nodes_of_ros_that_hear_the_gateway(tmp_path: Path) -> None:
    right = ROS_TOKEN.format(0, "vehicle", "std_msgs", "Bool", BOOL_HASH)
    own = ROS_TOKEN.format(5, "acoustic_gateway_1", "std_msgs", "Bool", BOOL_HASH)
    other = ROS_TOKEN.format(7, "of_others", "std_msgs", "Bool", BOOL_HASH)
    assert nodes_found(tmp_path, right, own, other) == []
    assert nodes_found(tmp_path, own) == []
    assert nodes_found(tmp_path, own, unmet=(own,)) == []


@pytest.mark.parametrize(
    ("token", "distro", "what"),
    [
        ((5, "vehicle", "std_msgs", "Bool", BOOL_HASH), "jazzy", "domain 0; here they are in 5"),
        ((0, "vehicle", "std_msgs", "Int8", "RIHS01_" + "0" * 64), "jazzy", "is std_msgs/msg/Int8"),
        ((0, "vehicle", "std_msgs", "Bool", "RIHS01_" + "0" * 64), "jazzy", "another definition"),
        ((0, "vehicle", "std_msgs", "Bool", "TypeHashNotSupported"), "jazzy", "are of Humble"),
        ((0, "vehicle", "std_msgs", "Bool", BOOL_HASH), "humble", "a later distribution"),
    ],
)
def test_nodes_of_ros_that_never_hear_the_gateway(
    token: tuple[object, ...], distro: str, what: str, tmp_path: Path
) -> None:
    (found,) = nodes_found(tmp_path, ROS_TOKEN.format(*token), distro=distro)
    assert what in found.what
    assert "/auv1/vehicle" in found.what


def test_a_peer_without_gossip_beside_a_router_of_peers(tmp_path: Path) -> None:
    """As rmw_zenohd is set: it brokers nothing between peers, and they meet by its gossip."""

    async def main() -> None:
        port = free_port()
        brokering = {"router": {"peers_failover_brokering": False}}
        settings = json.loads(zenoh_settings("router", listen=port)) | {"routing": brokering}
        here = {"endpoints": ["tcp/127.0.0.1:0"]}
        token = ROS_TOKEN.format(0, "vehicle", "std_msgs", "Bool", BOOL_HASH)
        peer = json.loads(zenoh_settings("peer", connect=port)) | {"listen": here}
        with (
            zenoh.open(zenoh.Config.from_json5(json.dumps(settings))),
            zenoh.open(zenoh.Config.from_json5(json.dumps(peer))) as node,
        ):
            kept = node.liveliness().declare_token(token)
            for is_gossiping in (True, False):
                scouting = {"multicast": {"enabled": False}, "gossip": {"enabled": is_gossiping}}
                path = write(tmp_path, zenoh=json.dumps(peer | {"scouting": scouting}))
                running, _ = await look(read_config(path), ())
                found = list(judge_nodes(read_config(path), running))
                assert [each.what for each in found if "gossip" in each.what] == (
                    [] if is_gossiping else [found[0].what]
                )
            del kept

    run(main())


def test_a_router_that_is_not_there(tmp_path: Path) -> None:
    async def main() -> None:
        port = free_port()
        path = write(tmp_path, zenoh=zenoh_settings("client", connect=port))
        told = await problem(path)
        assert f"no Zenoh router at tcp/127.0.0.1:{port}" in told.text

    run(main())


def test_a_serial_port_that_the_user_may_not_open(readable: Path) -> None:
    async def main() -> None:
        async with modems() as server:
            place = server.open_terminal(1)
            path = write(readable, links=link(f"evologics/{place.locator}"))
            # Who may open it finds nothing wrong; and what is imported late is there then.
            assert (await examine(path)).code == 0
            with unprivileged(place.locator.removeprefix("serial:")):
                told = await problem(path)
        assert "Permission denied" in told.text
        assert "dialout" in told.findings[0]["cure"]

    run(main())


def test_a_disk_that_is_full_for_the_journal(tmp_path: Path) -> None:
    async def main() -> None:
        path = write(tmp_path, journal="journal")
        with full_disk():
            told = await problem(path)
        assert "the journal cannot be written to" in told.text

    run(main())
    assert not list(tmp_path.glob(".zacoustic-doctor-*"))


def test_more_is_planned_than_fits(tmp_path: Path) -> None:
    async def main() -> None:
        status = {**STREAMS[0], "topic": "auv1/status", "min_interval_s": 0.5}
        told = await problem(write(tmp_path, streams=[status, STREAMS[1]]))
        assert "auv1/status alone takes" in told.text
        assert "auv1/status: min_interval_s: " in told.findings[0]["cure"]

    run(main())


def test_a_source_level_for_the_bench(tmp_path: Path) -> None:
    async def main() -> None:
        async with modem_file(tmp_path, {"L": 3}) as path:
            assert "source level is 3, -20 dB" in (await problem(path)).text
        async with modem_file(tmp_path, {"L": 3}, behind="#deck=true") as path:
            assert (await examine(path)).code == 0

    run(main())


def test_a_gain_for_the_tank(tmp_path: Path) -> None:
    async def main() -> None:
        async with modem_file(tmp_path, {"G": 1}) as path:
            assert "gain of the receiver is 1, low" in (await problem(path)).text
        async with modem_file(tmp_path, {"G": 1}, behind="#gain=0") as path:
            assert (await examine(path)).code == 0

    run(main())


def test_a_firmware_that_nobody_knows(tmp_path: Path) -> None:
    async def main() -> None:
        async with modem_file(tmp_path, firmware="3.0-beta") as path:
            told = await problem(path)
        assert "firmware of the modem is unknown: it answers '3.0-beta'" in told.text

    run(main())


# Manners


def test_a_port_that_is_in_use_is_left_alone(tmp_path: Path) -> None:
    async def main() -> None:
        async with modems() as server:
            place = server.open_terminal(1)
            stream = ByteStream(place.locator)
            holder = _Holder()
            stream.open(holder)
            await holder.opened.wait()
            told = await examine(write(tmp_path, links=link(f"evologics/{place.locator}")))
            await stream.close()
        assert told.code == 1
        assert "in use by another program" in told.text
        assert "--connect" in told.findings[0]["cure"]

    run(main())


def test_a_gateway_that_runs_is_asked_about_its_modem(tmp_path: Path) -> None:
    async def main() -> None:
        async with modems(settings={"L": 3, "G": 1}) as server:
            place = server.open_terminal(1)
            locator = f"evologics/{place.locator}"
            async with gateway(1, registry.create(locator, 1)) as shore:
                path = beside(tmp_path, shore, locator)
                told = await problem(path)
        said = [each["what"].split(",")[0] for each in told.findings]
        assert said == ["source level is 3", "gain of the receiver is 1"]

    run(main())


def test_a_gateway_that_was_given_its_modem_on_the_command_line(tmp_path: Path) -> None:
    async def main() -> None:
        async with modems(settings={"L": 3}) as server:
            locator = f"evologics/{server.open_terminal(1).locator}"
            modem = registry.create(locator, 1)
            async with gateway(1, modem, links=link(locator)) as shore:
                told = await problem(beside(tmp_path, shore))
        assert "source level is 3, -20 dB" in told.text

    run(main())


def test_a_link_of_a_running_gateway_that_is_down(tmp_path: Path) -> None:
    async def main() -> None:
        locator = f"desert/127.0.0.1:{free_port()}"
        async with gateway(1, registry.create(locator, 1)) as shore:
            path = beside(tmp_path, shore, locator)
            told = await problem(path)
        assert "the link of the running gateway is " in told.text
        assert "waits for DESERT at" in told.text

    run(main())


def test_the_kernel_says_whether_anything_keeps_the_clock_right(tmp_path: Path) -> None:
    config = read_config(write(tmp_path, links=link("sim/127.0.0.1:1", TDMA)))
    assert [each.what for each in check_clock(config, None, lambda: False)] == [
        "nothing keeps the clock of this computer right, and TDMA goes by it"
    ]
    assert not list(check_clock(config, None, lambda: True))
    assert not list(check_clock(config, None, lambda: None))
    told_by_a_node = {**TDMA, "clock": 1}
    config = read_config(write(tmp_path, links=link("sim/127.0.0.1:1", told_by_a_node)))
    assert not list(check_clock(config, None, lambda: False))
    assert kernel_synchronised() in (True, False, None)


def test_the_report_for_people(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path, zenoh=zenoh_settings("client", connect=free_port()))
    assert main(["config", "doctor", str(path)]) == 1
    told = capsys.readouterr().out
    assert "! no Zenoh router at" in told
    assert "  at sea: the gateway carries nothing" in told
    assert "  cure:   start the router" in told
    assert f"{path}, node 1: one thing is wrong" in told


def test_nothing_is_transmitted_and_nothing_is_set(tmp_path: Path) -> None:
    async def main() -> None:
        async with modems(settings={"RI": 2, "L": 1}) as server:
            place = await server.listen(1, "127.0.0.1", 0)
            _, host, port = place.locator.split(":")
            reader, writer = await asyncio.open_connection(host, int(port))
            locator = f"evologics/{place.locator}#source_level=0&retries=0"
            assert (await examine(write(tmp_path, links=link(locator)))).code == 0
            for question, answer in ((b"AT?RI", b"2"), (b"AT?L", b"1"), (b"AT?T", b"0")):
                writer.write(question + b"\n")
                assert (await reader.readline()).strip() == answer
            assert b"0 packets" in await _status(reader, writer)
            writer.close()

    run(main())


def test_a_link_without_checks_of_its_own_is_opened_and_closed(tmp_path: Path) -> None:
    async def main() -> None:
        locator = f"sim/127.0.0.1:{free_port()}#wait_s=0.2"
        told = await problem(write(tmp_path, links=link(locator)))
        assert "the modem cannot be used: " in told.text

    run(main())


class _Holder(RecordingReceiver):
    """Holds a serial port."""

    def __init__(self) -> None:
        super().__init__()
        self.opened = asyncio.Event()

    def stream_opened(self) -> None:
        self.opened.set()

    def bytes_received(self, data: bytes, received_at: int) -> None:
        pass

    def stream_lost(self, reason: str) -> None:
        pass


async def _status(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bytes:
    writer.write(b"AT?S\n")
    lines = b""
    while b"free" not in lines:
        lines += await reader.readline()
    return lines


async def _until_document(
    session: zenoh.Session, address: int, name: str, says: Callable[[Any], bool]
) -> None:
    """Wait until a document of a gateway says something; it is put when it changes."""
    key = f"@acoustic/{address}/{name}"
    heard = await hear(session, key)
    replies = await get(session, key)
    document = json.loads(replies.payload(key))
    while not _says(says, document):
        document = json.loads(await heard.payload())


def _says(says: Callable[[Any], bool], document: Any) -> bool:
    try:
        return says(document)
    except KeyError:
        return False


def _has_own(least: int, dropped: dict[str, Any]) -> bool:
    return bool(dropped["channel"]["own"] >= least)


def _has_cut(least: int, document: dict[str, Any]) -> bool:
    return bool(document["diagnostics"]["pieces_cut"] >= least)
