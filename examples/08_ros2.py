"""ROS 2 across the channel: a command and a service of nodes on rmw_zenoh, without ROS here.

Run it: python examples/08_ros2.py

The two "nodes" say on Zenoh what real ones say; with ROS 2 at hand start those instead, each beside
its gateway: zacoustic run gateway examples/08_fleet.json5 --address N --link MODEM
"""

import asyncio
import json
import queue
import socket
import time
from pathlib import Path

import zenoh

from zacoustic import read_config
from zacoustic.gateway import Gateway
from zacoustic.json5 import read_json5
from zacoustic.ros.attachment import Attachment
from zacoustic.ros.streams import RosService, RosTopic
from zacoustic.testing import scenario_from_mapping
from zacoustic_sim import SimMedium

HERE = Path(__file__).parent
CONFIG = read_config(HERE / "08_fleet.json5", address=1)
TIME_SCALE = 4.0  # times faster than real, so that nobody waits


async def main() -> None:
    scenario = scenario_from_mapping(read_json5(HERE / "04_water.json5"), source="04_water.json5")
    channel = SimMedium(scenario, time_scale=TIME_SCALE)
    shore, auv1 = free_port(), free_port()
    async with gateway(1, shore, channel), gateway(2, auv1, channel):
        await asyncio.to_thread(nodes, shore, auv1)


def gateway(address: int, port: int, channel: SimMedium) -> Gateway:
    config = read_config(HERE / "08_fleet.json5", address=address)
    assert config.zenoh_config is not None
    config.zenoh_config.insert_json5("listen/endpoints", f'["tcp/127.0.0.1:{port}"]')
    return Gateway(config, link=channel.link(address), notify=print)


def nodes(shore_port: int, auv1_port: int) -> None:
    """Two nodes with the keys, CDR and attachments of rmw_zenoh."""
    assert CONFIG.ros is not None
    cmd_vel, arm = CONFIG.ros.streams[11], CONFIG.ros.streams[20]
    assert isinstance(cmd_vel, RosTopic)
    assert isinstance(arm, RosService)
    cmd_vel_key, arm_key = str(cmd_vel.key(0, "auv1/cmd_vel")), str(arm.key(0, "auv1/arm"))
    with client(shore_port) as shore, client(auv1_port) as auv1:
        heard: queue.Queue[zenoh.Sample] = queue.Queue()
        auv1.declare_subscriber(cmd_vel_key, heard.put)

        def serve(query: zenoh.Query) -> None:
            with query:
                asked = arm.request.read(query.payload.to_bytes() if query.payload else b"")[0]
                answer = arm.response.write({"success": asked["data"], "message": "armed"})
                query.reply(arm_key, answer, attachment=query.attachment)

        auv1.declare_queryable(arm_key, serve, complete=True)
        command = {"linear": {"x": 1.2}, "angular": {"z": -0.3}}  # what is missing is zero
        shore.put(cmd_vel_key, cmd_vel.message.write(command), attachment=beside(1))
        print("auv1 hears", cmd_vel.message.read(heard.get(timeout=60).payload.to_bytes())[0])
        request = arm.request.write({"data": True})
        for reply in shore.get(arm_key, payload=request, attachment=beside(1), timeout=60):
            assert reply.ok is not None, reply.err
            print("shore is answered", arm.response.read(reply.ok.payload.to_bytes())[0])


def beside(sequence: int) -> bytes:
    return Attachment(sequence=sequence, stamp_ns=time.time_ns(), gid=bytes(16)).encode()


def client(port: int) -> zenoh.Session:
    settings = {"mode": "client", "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]}}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    asyncio.run(main())
