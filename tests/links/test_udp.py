import asyncio
import random
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.links.udp_pair import UdpHarness, free_port, locators
from tests.runtime.loop_checks import run
from zacoustic import Node
from zacoustic.core.linktypes import Transmission, TransmitOutcome
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link import registry
from zacoustic.testing.linkpair import RecordingReceiver, pair

ROOT: Final = Path(__file__).parents[2]
FLEET: Final = ROOT / "examples" / "07_reliable.json5"


@pytest.mark.parametrize("is_group", [False, True])
def test_samples_and_objects_cross(is_group: bool) -> None:
    async def scenario() -> None:
        near, far = locators(is_group=is_group, settings="&latency_s=0.01")
        shore, auv = Node("shore", config=FLEET, link=near), Node("auv1", config=FLEET, link=far)
        async with shore, auv:
            received = auv.subscribe(bytes, "auv1/waypoint")
            log = shore.create_publisher(bytes, "auv1/waypoint")
            for payload in (b"small", random.Random(7).randbytes(20_000)):
                log.publish(payload)
                assert (await received.receive()).value == payload

    run(scenario(), limit_s=30.0)


def test_two_processes_of_one_machine_hear_each_other() -> None:
    near, far = locators()
    script = [sys.executable, "-u", "examples/01_pub_sub.py"]
    with (
        subprocess.Popen([*script, "shore", "--link", near], cwd=ROOT, stdout=-1, text=True) as ear,
        subprocess.Popen([*script, "vehicle", "--link", far], cwd=ROOT, stdout=-1) as mouth,
    ):
        try:
            assert ear.stdout is not None
            assert "depth=" in ear.stdout.readline()
        finally:
            ear.kill()
            mouth.kill()


def test_node_hears_nothing_of_its_own_in_a_group() -> None:
    async def scenario() -> None:
        async with pair(UdpHarness(is_group=True)) as (near, far):
            await near.send(b"once")
            await far.hears(b"once")
            assert not near.receiver.frames
            assert near.link.diagnostics()["received"] == 0

    run(scenario())


def test_what_the_network_does_not_take_is_aborted() -> None:
    async def scenario() -> None:
        # 240.0.0.1 is reserved: no network has a way to it.
        link = registry.create(f"udp/127.0.0.1:{free_port()}#peers=240.0.0.1:9", 1)
        receiver = RecordingReceiver()
        await link.open(receiver)
        link.transmit(Transmission(transmission_id=1, frame_bytes=b"x"))
        await receiver.wait("report", lambda: receiver.reports, 5.0)
        assert receiver.reports[0].outcome is TransmitOutcome.ABORTED
        assert "240.0.0.1:9" in receiver.reports[0].detail
        assert link.diagnostics()["errors"] == 1
        await link.close()

    run(scenario())


def test_port_that_is_taken_is_told() -> None:
    async def scenario() -> None:
        near, _ = locators()
        first, second = registry.create(near, 1), registry.create(near, 1)
        await first.open(RecordingReceiver())
        with pytest.raises(LinkOpenError, match="in use"):
            await second.open(RecordingReceiver())
        with pytest.raises(LinkOpenError, match="open already"):
            await first.open(RecordingReceiver())
        await second.close()
        await first.close()
        await asyncio.sleep(0)

    run(scenario())


@pytest.mark.parametrize(
    ("locator", "message"),
    [
        ("udp/127.0.0.1:7000", "peers are none; allowed"),
        ("udp/239.1.2.3:7000#peers=127.0.0.1:7001", "peers are 127.0.0.1:7001; allowed"),
        ("udp/[ff02::1]:7000", "IPv4 multicast group"),
        ("udp/vehicle:7000#peers=127.0.0.1:7001", "'vehicle:7000' is no address; allowed: IP:PORT"),
        ("udp/127.0.0.1#peers=127.0.0.1:7001", "is no address"),
        ("udp/127.0.0.1:7000#peers=127.0.0.1:70000", "allowed: 1..65535"),
        ("udp/239.1.2.3:7000#bit_rate_bps=0", "bit_rate_bps is '0'; allowed: a number, above 0"),
        ("udp/239.1.2.3:7000#interface=eth0", "interface is 'eth0'"),
    ],
)
def test_locator_that_cannot_work_is_refused(locator: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message.replace("[", r"\[")):
        registry.create(locator, 1)
