"""A gateway whose computer does not know the time: silent, and it says so; ages do not jump."""

import json
import time
from typing import Any

import zenoh

from tests.gateway.networks import SECTION, Channel, hear, local_network, run, until
from tests.gateway.networks import get as ask
from zacoustic.app.tools.watch.board import Board
from zacoustic.run.hostclock import ClockState, HostClock

YEARS_NS = 50 * 365 * 86_400 * 10**9


async def get(client: zenoh.Session, key: str) -> dict[str, Any]:
    """Return a document."""
    found: dict[str, Any] = json.loads((await ask(client, key)).payload(key))
    return found


class Computer:
    """The clock of a computer, which a test sets."""

    def __init__(self) -> None:
        self.wrong_ns = 0
        self.error_ns: int | None = 1_000_000
        self.host = HostClock(
            utc_ns=lambda: time.time_ns() + self.wrong_ns,
            ask=lambda: ClockState(error_ns=self.error_ns),
        )


def scheduled() -> dict[str, Any]:
    access = {
        "method": "tdma", "slots": [1], "slot_s": 0.5, "clock_error_s": 0.005, "max_range_m": 30,
    }  # fmt: skip
    return SECTION | {"links": [{"locator": "sim/127.0.0.1:1", "access": access}]}


def test_gateway_that_starts_in_the_seventies_transmits_when_its_clock_is_set() -> None:
    async def scene() -> None:
        channel, computer = Channel(), Computer()
        computer.wrong_ns, computer.error_ns = -YEARS_NS, None
        async with local_network(1, channel, section=scheduled(), host=computer.host) as shore:
            with shore.client() as client:
                told = await hear(client, "@acoustic/1/link")
                client.put("chat", b"early")
                doubt = "UTC is not known: the clock of this computer is not set"
                assert doubt in [each.facts["doubt"] for each in shore.told("clock")]
                link = await get(client, "@acoustic/1/link")
                assert (link["silent"], link["why_silent"]) == (True, doubt)
                # A sample waits for a frame outside of the engine first, for a second at most.
                while (waits := json.loads(await told.payload())["waits"]) is None:
                    pass
                assert waits == {"why": "clock", "until_unix_s": None}
                events = (await get(client, "@acoustic/1/events"))["events"]
                assert any(each["trouble"] and doubt in each["text"] for each in events)
                assert channel.sent_by(1) == 0
                computer.wrong_ns, computer.error_ns = 0, 1_000_000
                client.put("chat", b"now")
                await until(lambda: channel.sent_by(1), channel.changed)
                assert "" in [each.facts["doubt"] for each in shore.told("clock")]
                link = await get(client, "@acoustic/1/link")
                assert (link["silent"], link["why_silent"]) == (False, "")
                while json.loads(await told.payload())["waits"] is not None:
                    pass

    run(scene())


def test_ages_go_on_when_the_clock_of_the_gateway_is_set_back() -> None:
    async def scene() -> None:
        channel, computer = Channel(), Computer()
        async with (
            local_network(1, channel) as vehicle,
            local_network(2, channel, host=computer.host) as shore,
        ):
            with vehicle.client() as there, shore.client() as here:
                board = Board()

                async def look() -> float:
                    for name in ("clock", "node", "link", "streams", "peers"):
                        key = f"@acoustic/2/{name}"
                        board.take(key, json.dumps(await get(here, key)).encode())
                    found = [each.heard_ago_s for each in board.view(2).peers if each.address == 1]
                    return found[0] if found and found[0] is not None else -1.0

                there.put("chat", b"hello")
                before_s = -1.0
                while before_s < 0:
                    before_s = await look()
                for wrong_ns in (-2 * YEARS_NS, 7200 * 10**9, -7200 * 10**9):
                    computer.wrong_ns = wrong_ns
                    after_s = await look()
                    assert before_s <= after_s < before_s + 20
                    before_s = after_s

    run(scene())
