"""The verbs `zacoustic route`: show and change the routes over relays, measure which are best."""

import random
from typing import TYPE_CHECKING, Any, Final

from zacoustic.app.cli.support.participant import Participant
from zacoustic.app.cli.support.printing import print_json, print_note, print_text
from zacoustic.app.cli.support.rows import MOST_NODES, endpoint, flag, option, seconds, whole, word
from zacoustic.app.cli.support.verb import Verb
from zacoustic.core.wire.relay import MOST_PROBES
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, EXIT_TIMED_OUT
from zacoustic.text.digits import whole_number

if TYPE_CHECKING:
    from collections.abc import Iterator

    from zacoustic.app.tools.field.changing import PathChanged
    from zacoustic.app.tools.field.probing import Proposal, Survey
    from zacoustic.app.tools.field.routes import RouteShown
    from zacoustic.config import Config
    from zacoustic.core.streams.table import StreamTable

_LONGEST_S: Final = 600.0


class Show(Verb):
    """The routes of a file, and how their hops do.

    the counters are those of the gateways that answer here

    Example:
      zacoustic route show router.json5
    """

    config: str = word("FILE", "Zenoh config with plugins.acoustic")
    connect: list[str] | None = endpoint()
    json: bool = flag("one JSON object per route")

    async def work(self) -> None:
        """Print them.

        Raises:
            ConfigError: The file is wrong.
            SessionError: No router is at --connect.
        """
        from zacoustic.app.tools.field.routes import shown_routes
        from zacoustic.app.tools.fleetfile import read_fleet

        routes = await shown_routes(read_fleet(self.config), self.connect)
        for each in routes:
            self.show(each, _route_text)
        if not routes and not self.json:
            print_text("no routes: each node hears each other one, or nothing is measured yet")


class Asking(Participant):
    """A verb that asks several nodes."""

    node: str | None = option("A,B,…", "only these addresses (default: all of the path)")
    timeout: float = seconds("how long to try each hop of a question, s", 60.0, most=_LONGEST_S)


class Probe(Asking):
    """Measure the loss of every pair of nodes, propose routes.

    Each node transmits --count probes of four bytes in turn, and all others
    count them; then each is asked for its counts. A node that does not answer directly is asked
    over others: it must execute the commands of its neighbour. Nothing else should be on the
    channel.

    Examples:
      zacoustic route probe --config router.json5                        all nodes of the file
      zacoustic route probe --config router.json5 --count 16 --node 2,3,5
      zacoustic route probe --config shore.json5 --link evologics/tcp:192.168.0.209:9200 --json
    """

    count: int = whole("N", f"probes of each node, 1..{MOST_PROBES}", 8, least=1, most=MOST_PROBES)
    node: str | None = option("A,B,…", "only these addresses (default: all nodes of --config)")
    seed: int | None = whole("N", "draws the number of the run (default: random)")

    async def work(self) -> int:
        """Measure; exit code 3 if no other node has answered.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, LocalError: No node asks here.
        """
        from zacoustic.app.tools.field.probing import survey
        from zacoustic.app.tools.field.routes import GatewayAsker, LinkAsker

        config = self.fleet()
        nodes = _nodes(self.node, config)
        async with self.way(config, GatewayAsker, LinkAsker) as asker:
            found = await survey(
                asker,
                nodes,
                count=self.count,
                timeout_s=self.timeout,
                rng=random.Random(self.seed),
                tell=print_note,
            )
        proposed = _proposed(found, config)
        if self.json:
            print_json(_record(found, proposed))
        else:
            print_text(_survey_text(found, proposed))
        return EXIT_OK if len(found.over) > 1 else EXIT_TIMED_OUT


class Changing(Asking):
    """A verb that changes a route."""

    id: int = word("ID", "number of the route in the file", type=int)

    async def change(self, path: tuple[int, ...] | None) -> int:
        """Give the route a path, or None: that of the file again.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, ServiceError, CallTimeoutError: Nothing has changed.
        """
        from zacoustic.app.tools.field.changing import change_path
        from zacoustic.app.tools.field.routes import GatewayAsker, LinkAsker

        config = self.fleet()
        if config is None:
            raise ConfigError("--config is missing; allowed: the file with the route")
        routes = {each.route_id: each.path for each in config.rules.routes}
        if self.id not in routes:
            known = ", ".join(map(str, routes)) or "none, the file has no routes"
            raise ConfigError(f"ID {self.id}; allowed: {known}")
        of_file = routes[self.id]
        if path is not None:
            _check_path(path, of_file, config)
        async with self.way(config, GatewayAsker, LinkAsker) as asker:
            changed = await change_path(
                asker,
                self.id,
                of_file if path is None else path,
                undo=path is None,
                nodes=[] if self.node is None else _addresses("node", self.node),
                taken=[*routes, *(each.number for each in config.rules.bonds)],
                timeout_s=self.timeout,
                tell=print_note,
            )
        self.show(changed, _changed_text)
        if not changed.failed:
            return EXIT_OK
        return EXIT_TIMED_OUT if changed.timed_out else EXIT_FAILED


class Set(Changing):
    """Give a route another path, without a restart.

    all nodes are asked first: if one does not answer, nothing changes. Then the relays
    are told, then the ends, so that no frame is lost on the way. It survives a restart
    of nodes with a journal; each executes it for the node before it on the path

    Example:
      zacoustic route set 1 --path 1,4,3 --config router.json5
    """

    path: str = option(
        "A,B,…",
        "addresses from one end to the other; the ends are those of the file",
        required=True,
    )

    async def work(self) -> int:
        """Change it; exit code 3 if a node has not answered in time, 1 if one refuses."""
        from zacoustic.core.wire.routing import check_path

        path = tuple(_addresses("path", self.path))
        try:
            check_path(path)
        except ValueError as error:
            raise ConfigError(f"--{error}") from None
        return await self.change(path)


class Reset(Changing):
    """Give a route the path of the file again.

    Example:
      zacoustic route reset 1 --config router.json5
    """

    async def work(self) -> int:
        """Reset it; exit codes as of `set`."""
        return await self.change(None)


def _check_path(path: tuple[int, ...], of_file: tuple[int, ...], config: "Config") -> None:
    """Check that a path has the ends and the nodes of the file.

    Raises:
        ConfigError: It has not.
    """
    written = ",".join(map(str, path))
    if (path[0], path[-1]) != (of_file[0], of_file[-1]):
        allowed = f"from {of_file[0]} to {of_file[-1]}, as in the file"
        raise ConfigError(f"--path {written}; allowed: {allowed}")
    for each in path:
        if config.table.nodes and each not in config.table.nodes:
            raise ConfigError(f"--path {written}: no node {each} in the file")


def _changed_text(changed: "PathChanged") -> str:
    path = " - ".join(map(str, changed.path))
    if not changed.failed:
        return f"route {changed.route}: {path}, revision {changed.revision}, at all nodes asked"
    done = ", ".join(map(str, changed.done)) or "no node"
    return (
        f"route {changed.route}: {path}: {changed.why}; told: {done}. Both paths still work; give "
        "the command again"
    )


def _nodes(written: str | None, config: "Config | None") -> list[int]:
    """Return the addresses to measure.

    Raises:
        ConfigError: One is not valid, or there are none.
    """
    if written is None:
        nodes = [] if config is None else sorted(config.table.nodes)
        if not nodes:
            raise ConfigError("--node is missing; allowed: addresses, or --config with nodes")
        return nodes
    return sorted(set(_addresses("node", written)))


def _addresses(name: str, written: str) -> list[int]:
    """Read addresses with commas between them.

    Raises:
        ConfigError: One is not valid.
    """
    found = []
    for text in written.split(","):
        address = whole_number(text.strip())
        if address is None or not 1 <= address <= MOST_NODES:
            allowed = f"addresses 1..{MOST_NODES}, with commas"
            raise ConfigError(f"--{name} {written}; allowed: {allowed}")
        found.append(address)
    return found


def _proposed(found: "Survey", config: "Config | None") -> "list[Proposal]":
    from zacoustic.app.tools.field.probing import proposals

    routes = () if config is None else config.rules.routes
    wanted = [
        *((found.own, each) for each in found.over),
        *((each.path[0], each.path[-1]) for each in routes),
        *(() if config is None else _ends_of_topics(config.table)),
    ]
    pairs = {frozenset(each): each for each in reversed(wanted) if each[0] != each[1]}
    return proposals(
        found,
        reversed(pairs.values()),
        routes=routes,
        names=None if config is None else config.table.nodes,
        taken=() if config is None else [each.number for each in config.rules.bonds],
    )


def _ends_of_topics(table: "StreamTable") -> "Iterator[tuple[int, int]]":
    """Yield who publishes to whom, where a topic lists both."""
    from zacoustic.core.streams.specs import TopicSpec

    for stream in table:
        if isinstance(stream.spec, TopicSpec):
            for publisher in stream.spec.publishers or ():
                for subscriber in stream.spec.subscribers or ():
                    yield publisher, subscriber


def _record(found: "Survey", proposed: "list[Proposal]") -> dict[str, Any]:
    import msgspec

    return {**msgspec.to_builtins(found), "routes": msgspec.to_builtins(proposed)}


def _route_text(route: "RouteShown") -> str:
    line = f"{route.id} {route.name}: {' - '.join(map(str, route.path))}"
    by = f" by {route.link}" if route.link else ""
    lines = [f"{line}{by}, {route.lifetime_s:g} s"]
    lines += [
        f"  changed at node {node}: {' - '.join(map(str, path))}"
        for node, path in route.changed.items()
    ]
    for hop in route.hops:
        each = hop.transmissions / hop.passed_on if hop.passed_on else None
        share = "" if each is None else f", {each:.1f} for each that arrived"
        lines.append(
            f"  {hop.node} to {hop.next_node}: {hop.transmissions} transmissions, "
            f"{hop.passed_on} arrived, {hop.given_up} given up, {hop.waiting} wait{share}"
        )
    return "\n".join(lines)


def _survey_text(found: "Survey", proposed: "list[Proposal]") -> str:
    from zacoustic.app.tools.field.probing import routes_text

    nodes = sorted({each.source for each in found.ways} | {each.hearer for each in found.ways})
    loss = {(each.source, each.hearer): each.loss for each in found.ways}
    lines = [f"lost of {found.count} probes, from the left to the top:"]
    lines.append("".join(["     ", *(f"{node:>6}" for node in nodes)]))
    for source in nodes:
        row = [
            f"{loss[source, hearer]:>6.0%}" if (source, hearer) in loss else "     -"
            for hearer in nodes
        ]
        lines.append("".join([f"{source:>5}", *row]))
    lines += [f"node {node}: {why}" for node, why in found.missing.items()]
    lines.append(
        f"airtime: {found.own_airtime_s:.1f} s of node {found.own}, {found.probes_airtime_s:.1f} s "
        "of the probes of the others, beside their answers"
    )
    for each in proposed:
        text = f"{each.name}: {each.transmissions:g} transmissions expected"
        if each.present and each.present != each.path:
            before = each.present_transmissions
            told = "one hop is not heard" if before is None else f"{before:.3g}"
            text += f"; over {list(each.present)}, as in the file: {told}"
        lines.append(text)
    return "\n".join([*lines, routes_text(proposed)])
