"""The verb `zacoustic ping`: round-trip time, range and signal of a remote node."""

import asyncio
from typing import TYPE_CHECKING, Any, Final

from zacoustic.app.cli.support.participant import Participant
from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.support.rows import MOST_NODES, seconds, whole, word
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_OK, EXIT_TIMED_OUT
from zacoustic.text.digits import whole_number
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.app.tools.field.pinging import Ping, PingStatistics, Spread
    from zacoustic.config import Config

MOST_FRAMES: Final = 6
"""Frames of a ping without losses: request, answer, two confirmations, a byte for the range, and
half a minute later the end of the call at both ends."""
MOST_BYTES: Final = 66
"""Their bytes in total, if the two nodes have not met yet."""


class PingNode(Participant):
    """Ping a remote node: round trip, range, signal."""

    epilog = f"""it costs at most {MOST_FRAMES} frames, {MOST_BYTES} bytes together:
question, answer, what confirms them, which rides on other frames where there are any, and, where a
modem measures ranges on demand, a byte for that; a lost one is repeated within --timeout. The node
answers by itself, whatever runs there, unless it is silent.

examples:
  zacoustic ping 2 --connect tcp/127.0.0.1:7447
  zacoustic ping auv1 --config router.json5 --count 10 --interval 30 --json
  zacoustic ping 2 --link evologics/tcp:192.168.0.209:9200 --config router.json5
"""

    node: str = word("NODE", "its address, or its name in --config")
    count: int = whole("N", "how often", 4, least=1)
    interval: float = seconds("least time from one to the next, s", 5.0)
    timeout: float = seconds("how long to wait for each answer, s", 30.0, most=600.0)

    def work(self) -> int:
        """Ping; exit code 3 if no ping was answered.

        Raises:
            DeliveryError, LocalError: The node cannot be asked.
        """
        done: list[Ping] = []
        try:
            asyncio.run(self._ping(done))
        except KeyboardInterrupt:
            if not done:
                raise
        return self._conclude(done)

    async def _ping(self, done: "list[Ping]") -> None:
        from zacoustic.app.tools.field.pinging import GatewayPinger, LinkPinger, pings

        config = self.fleet()
        node = _address(self.node, config)
        async with self.way(config, GatewayPinger, LinkPinger) as pinger:
            async for ping in pings(
                pinger, node, count=self.count, interval_s=self.interval, timeout_s=self.timeout
            ):
                done.append(ping)
                self.line(_record(node, ping), _text(node, ping))

    def _conclude(self, done: "list[Ping]") -> int:

        from zacoustic.app.tools.field.pinging import statistics_of

        found = statistics_of(done)
        if self.json:
            print_json({"statistics": found})
        else:
            print_text(_statistics_text(one_line(self.node), found))
        return EXIT_OK if found.answered else EXIT_TIMED_OUT


def _address(written: str, config: "Config | None") -> int:
    """Return the address of a node.

    Raises:
        ConfigError: It is not valid, or the name is unknown.
    """
    address = whole_number(written)
    if address is not None:
        if not 1 <= address <= MOST_NODES:
            raise ConfigError(f"NODE {written}; allowed: 1..254, or a name")
        return address
    if config is None:
        raise ConfigError(f"NODE {written}", hint="a name needs --config FILE; else an address")
    names = {name: address for address, name in config.table.nodes.items()}
    if written not in names:
        known = ", ".join(names) or "none"
        raise ConfigError(f"NODE {written}; allowed: an address, or one of: {known}")
    return names[written]


def _record(node: int, ping: "Ping") -> dict[str, Any]:
    import msgspec

    found = {} if ping.answer is None else msgspec.to_builtins(ping.answer)
    head = {"number": ping.number, "node": node, "answered": ping.answer is not None}
    found.pop("address", None)
    why = {"why": ping.why} if ping.why else {}
    return {**head, **found, **why, "unix_s": ping.unix_s}


def _text(node: int, ping: "Ping") -> str:
    answer = ping.answer
    if answer is None:
        return f"{ping.number}: {one_line(ping.why) or f'node {node}: no answer in time'}"
    return f"{ping.number}: {answer.text()}"


def _statistics_text(node: str, found: "PingStatistics") -> str:
    lost = 1 - found.answered / found.sent if found.sent else 0.0
    lines = [f"node {node}: {found.sent} sent, {found.answered} answered, {lost:.0%} lost"]
    if found.round_trip_s is not None:
        lines.append(f"round trip {_spread(found.round_trip_s, 2)} s")
    if found.range_m is not None:
        lines.append(f"range {_spread(found.range_m, 1)} m")
    return "\n".join(lines)


def _spread(spread: "Spread", digits: int) -> str:
    values = (spread.least, spread.mean, spread.most, spread.deviation)
    return f"min/mean/max/sd {'/'.join(f'{value:.{digits}f}' for value in values)}"
