"""Two Zenoh networks joined by sound: gateways from one file, plain Zenoh clients on both sides.

Run it: python examples/04_two_gateways.py
Without Python: zacoustic run medium examples/04_water.json5 --listen HOST:PORT, and on each
computer zacoustic run gateway examples/04_fleet.json5 --address N --link sim/HOST:PORT
"""

import asyncio
import json
import queue
import socket
import time
from pathlib import Path

import cbor2
import zenoh

from zacoustic import read_config
from zacoustic.gateway import Gateway, read_marker
from zacoustic.json5 import read_json5
from zacoustic.testing import scenario_from_mapping
from zacoustic_sim import SimMedium

HERE = Path(__file__).parent
TIME_SCALE = 4.0  # times faster than real, so that nobody waits


async def main() -> None:
    scenario = scenario_from_mapping(read_json5(HERE / "04_water.json5"), source="04_water.json5")
    channel = SimMedium(scenario, time_scale=TIME_SCALE)
    shore, auv1 = free_port(), free_port()
    async with gateway(1, shore, channel), gateway(2, auv1, channel):
        await asyncio.to_thread(applications, shore, auv1)


def gateway(address: int, port: int, channel: SimMedium) -> Gateway:
    config = read_config(HERE / "04_fleet.json5", address=address)
    assert config.zenoh_config is not None
    # Two networks on one computer cannot both have the port of the file.
    config.zenoh_config.insert_json5("listen/endpoints", f'["tcp/127.0.0.1:{port}"]')
    return Gateway(config, link=channel.link(address), notify=print)


def applications(shore_port: int, auv1_port: int) -> None:
    """What users run: it knows Zenoh and nothing of acoustics."""
    with client(shore_port) as shore, client(auv1_port) as auv1:
        samples: queue.Queue[zenoh.Sample] = queue.Queue()
        shore.declare_subscriber("auv1/**", samples.put)
        auv1.declare_queryable("auv1/arm", arm)
        started_s = time.monotonic()
        auv1.put("auv1/nav", cbor2.dumps({"lat": 54.32, "lon": 10.14, "depth": 12.5}))
        sample = samples.get(timeout=30)
        origin = read_marker(sample.attachment)
        print("shore hears", sample.key_expr, cbor2.loads(sample.payload.to_bytes()), origin)
        # Sound is slow: a call may need more than the 10 s that Zenoh waits by default.
        for reply in shore.get("auv1/arm", payload=cbor2.dumps({"arm": True}), timeout=60):
            assert reply.ok is not None, reply.err
            print("shore is answered", cbor2.loads(reply.ok.payload.to_bytes()))
        print(f"at sea this takes {(time.monotonic() - started_s) * TIME_SCALE:.1f} s")


def arm(query: zenoh.Query) -> None:
    with query:
        armed = query.payload is not None and cbor2.loads(query.payload.to_bytes())["arm"]
        query.reply("auv1/arm", cbor2.dumps({"armed": armed}))


def client(port: int) -> zenoh.Session:
    settings = {"mode": "client", "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]}}
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    asyncio.run(main())
