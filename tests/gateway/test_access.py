"""Medium access of the config reaches the engine, and a choice that cannot work is an error."""

import json
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.gateway.networks import SECTION, Channel, local_network, matched, run, until
from zacoustic.errors import ConfigError
from zacoustic.run.hostclock import ClockState, HostClock


def section(**access: Any) -> dict[str, Any]:
    return SECTION | {"links": [{"locator": "sim/127.0.0.1:1", "access": access}]}


def test_choice_that_cannot_work_on_the_link_is_one_line_at_the_start() -> None:
    async def scene() -> None:
        with pytest.raises(ConfigError, match=r'access\.method: "delegated"; this link does not'):
            async with local_network(1, Channel(), section=section(method="delegated")):
                pass

    run(scene())


def test_gateways_on_a_schedule_keep_their_slots(tmp_path: Path) -> None:
    def scheduled(address: int) -> dict[str, Any]:
        schedule = section(
            method="tdma", slots=[1, 2], slot_s=0.25, clock_error_s=0.005, max_range_m=30
        )
        return schedule | {"permit_log": str(tmp_path / f"{address}.jsonl")}

    async def scene() -> None:
        channel = Channel()
        right = HostClock(ask=lambda: ClockState(error_ns=1_000_000))
        async with (
            local_network(1, channel, section=scheduled(1), host=right) as shore,
            local_network(2, channel, section=scheduled(2), host=right) as vehicle,
        ):
            with shore.client() as here, vehicle.client() as there:
                for client in (here, there):
                    await matched(client, "chat")
                for number in range(4):
                    wanted = {address: channel.sent_by(address) + 1 for address in (1, 2)}
                    here.put("chat", f"here {number}")
                    there.put("chat", f"there {number}")
                    await until(partial(_have_sent, channel, wanted), channel.changed)

    run(scene())
    for address in (1, 2):
        lines = (tmp_path / f"{address}.jsonl").read_text().splitlines()
        assert lines
        for line in lines:
            begun_s = datetime.fromisoformat(json.loads(line)["utc"]).timestamp()
            assert round(begun_s * 1000) // 250 % 2 == address - 1


def _have_sent(channel: Channel, wanted: dict[int, int]) -> bool:
    return all(channel.sent_by(address) >= least for address, least in wanted.items())
