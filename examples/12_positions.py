"""A simulator of vehicles steers the channel: poses of ROS 2 become positions of nodes.

Gazebo, HoloOcean and Stonefish publish where a vehicle is as PoseStamped, z up. Under rmw_zenoh a
topic is a key of Zenoh; `adapt` takes poses from there and says positions, z down, to
`zacoustic run medium water.json5 --positions zenoh:positions --connect tcp/localhost:7447`.

Run it: python examples/12_positions.py   (`simulate` stands in for the simulator)
"""

import asyncio
import json
import socket
import struct
import subprocess
from pathlib import Path
from typing import IO

import zenoh

from zacoustic import Node

SCENARIO = Path(__file__).parent / "04_water.json5"
TYPE = "geometry_msgs::msg::dds_::PoseStamped_"


def adapt(session: zenoh.Session, topic: str, address: int) -> None:
    """Say where a node is whenever a pose of its vehicle arrives."""

    def say(pose: zenoh.Sample) -> None:
        cdr = bytes(pose.payload)
        order = "<" if cdr[1] & 1 else ">"
        (name_bytes,) = struct.unpack_from(f"{order}I", cdr, 12)  # behind the stamp: frame_id
        at = 4 + -(-(12 + name_bytes) // 8) * 8  # doubles begin at multiples of eight
        x, y, z = struct.unpack_from(f"{order}3d", cdr, at)
        session.put("positions", json.dumps({"address": address, "position": [x, y, -z]}))

    session.declare_subscriber(f"*/{topic}/{TYPE}/*", say)


async def simulate(session: zenoh.Session, topic: str) -> None:
    """Publish ten poses a second of a vehicle that leaves, as its simulator would."""
    head = b"\0\1\0\0" + struct.pack("<iII", 0, 0, 4) + b"map\0"
    for step in range(1000):
        pose = struct.pack("<7d", 200.0 + 20.0 * step, 0.0, -50.0, 0.0, 0.0, 0.0, 1.0)
        session.put(f"0/{topic}/{TYPE}/RIHS01_0", head + pose)
        await asyncio.sleep(0.1)


async def talk(session: zenoh.Session, link: str, medium: IO[str]) -> None:
    simulator = asyncio.create_task(simulate(session, "auv1/pose"))
    async with Node(1, link=link) as shore, Node(2, link=link) as auv1:
        heard = shore.subscribe(bytes, "auv1/raw", stream_id=1)
        publisher = auv1.create_publisher(bytes, "auv1/raw", stream_id=1)
        for _ in range(3):
            publisher.publish(b"here I am")
            await heard.receive()
            while (event := json.loads(medium.readline()))["event"] != "reception":
                pass
            print(f"the sound took {event['propagation_s']:.3f} s")
    simulator.cancel()


if __name__ == "__main__":
    with socket.create_server(("127.0.0.1", 0)) as free:
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    alone = {"multicast": {"enabled": False}}
    settings = {"mode": "router", "listen": {"endpoints": [endpoint]}, "scouting": alone}
    words = ["--positions", "zenoh:positions", "--connect", endpoint, "--json"]
    command = ["zacoustic", "run", "medium", str(SCENARIO), "--listen", "127.0.0.1:0", *words]
    with (
        zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as router,
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
    ):
        assert process.stdout is not None
        place = json.loads(process.stdout.readline())["address"]
        adapt(router, "auv1/pose", address=2)
        try:
            asyncio.run(talk(router, f"sim/{place}", process.stdout))
        finally:
            process.terminate()
