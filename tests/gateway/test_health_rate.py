"""How much health a gateway puts while everything changes: bounded, however large the fleet is."""

import asyncio
from collections.abc import Callable
from typing import Any, cast

import pytest

from zacoustic.zenoh.gateway.status.dates import Dates
from zacoustic.zenoh.gateway.status.health import BYTES_PER_S, Health
from zacoustic.zenoh.session.session import ZenohSession

TOUCHED_S = 600.0


class Fleet:
    """The documents, session and dates of a gateway that hears many nodes."""

    def __init__(self, nodes: int) -> None:
        self.nodes = nodes
        self.frames = 0
        self.times_set = 0
        self.puts: list[tuple[str, bytes]] = []

    def documents(self) -> dict[str, object]:
        peer = {"epoch": 12, "same_table": True, "metrics": {"snr_db": 12.5, "integrity": 190.0},
                "heard_at_unix_s": 1_750_000_000.123 + self.frames, "name": "auv"}  # fmt: skip
        peers = {str(each): {**peer, "name": f"auv{each}"} for each in range(1, self.nodes)}
        return {"peers": peers, "link": {"frames_received": self.frames}}

    def look(self) -> None:
        """Take no notice of the wall clock."""

    def told(self, document: object) -> object:
        return document

    def now_unix_s(self) -> float:
        return 1_750_000_000.0

    def put(self, key: str, payload: bytes, **_: Any) -> None:
        self.puts.append((key, payload))


@pytest.mark.parametrize("nodes", [2, 40, 254])
def test_health_of_a_large_fleet_is_put_less_often_and_its_last_state_arrives(
    nodes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene() -> None:
        loop = asyncio.get_running_loop()
        now_s = 0.0
        timers: list[asyncio.TimerHandle] = []

        def call_at(when: float, call: Callable[[], object]) -> asyncio.TimerHandle:
            timers.append(asyncio.TimerHandle(when, call, (), loop))
            return timers[-1]

        def pass_until(end_s: float) -> None:
            nonlocal now_s
            while due := [each for each in timers if not each.cancelled() and each.when() <= end_s]:
                first = min(due, key=lambda each: each.when())
                timers.remove(first)
                now_s = max(now_s, first.when())
                first._run()
            now_s = end_s

        monkeypatch.setattr(loop, "time", lambda: now_s)
        monkeypatch.setattr(loop, "call_at", call_at)
        fleet = Fleet(nodes)
        health = Health(1, cast(ZenohSession, fleet), [fleet], cast(Dates, fleet))
        while now_s < TOUCHED_S:
            fleet.frames += 1
            health.touch()
            pass_until(now_s + 0.1)
        by_key: dict[str, list[bytes]] = {}
        for key, payload in fleet.puts:
            by_key.setdefault(key.rpartition("/")[2], []).append(payload)
        assert TOUCHED_S * 0.9 <= len(by_key["link"]) <= TOUCHED_S + 1
        size_bytes = len(by_key["peers"][0])
        assert sum(map(len, by_key["peers"])) <= BYTES_PER_S * TOUCHED_S + size_bytes
        assert len(by_key["peers"]) >= 0.75 * min(TOUCHED_S, TOUCHED_S * BYTES_PER_S / size_bytes)
        if nodes == 40:
            assert size_bytes < 2 * BYTES_PER_S
        pass_until(now_s + 60)
        last = {key.rpartition("/")[2]: payload for key, payload in fleet.puts}
        assert b'"frames_received":%d' % fleet.frames in last["link"]
        assert b"%d.123" % (1_750_000_000 + fleet.frames) in last["peers"]
        assert not [each for each in timers if not each.cancelled()], "an idle gateway has no timer"
        health.close()

    asyncio.run(scene())
