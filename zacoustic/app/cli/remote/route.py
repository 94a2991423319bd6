"""The verb `zacoustic route`: shows the routes over relays, and measures which are best."""

import argparse
import asyncio
import contextlib
import random
from typing import TYPE_CHECKING, Any, Final

from zacoustic.app.cli.support.arguments import (
    add_connect,
    add_json,
    check_positive,
)
from zacoustic.app.cli.support.participant import add_node_arguments, make_node
from zacoustic.app.cli.support.printing import print_json, print_note, print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import (
    EXIT_FAILED,
    EXIT_OK,
    EXIT_TIMED_OUT,
    Command,
    CommandGroup,
)
from zacoustic.text.digits import whole_number

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Iterator, Sequence

    from zacoustic.app.tools.field.changing import PathChanged
    from zacoustic.app.tools.field.probing import Asker, Proposal, Survey
    from zacoustic.app.tools.field.routes import RouteShown
    from zacoustic.config import Config
    from zacoustic.core.streams.table import StreamTable

_MOST_NODES: Final = 254
_LONGEST_S: Final = 600.0
_PROBE_EXAMPLE: Final = """Each node transmits --count probes of four bytes in turn, and all others
count them; then each is asked for its counts. A node that does not answer directly is asked over
others: it must execute the commands of its neighbour. Nothing else should be on the channel.

examples:
  zacoustic route probe --config router.json5                        all nodes of the file
  zacoustic route probe --config router.json5 --count 16 --node 2,3,5
  zacoustic route probe --config shore.json5 --link evologics/tcp:192.168.0.209:9200 --json
"""


class RouteCommand(CommandGroup):
    """Routes over relays."""

    name = "route"

    def __init__(self) -> None:
        members: dict[str, Command] = {
            each.name: each for each in (ShowRoutes(), ProbeRoutes(), SetRoute(), ResetRoute())
        }
        super().__init__(self.name, members, tuple(members))
        self.summary = "show and change the routes over relays, measure which are best"  # type: ignore[misc]


class ShowRoutes(Command):
    """Shows the routes of a file, with the counters of their hops."""

    name = "show"
    summary = "the routes of a file, and how their hops do"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the file, and where Zenoh is joined."""
        parser.add_argument("config", metavar="FILE", help="Zenoh config with plugins.acoustic")
        add_connect(parser)
        add_json(parser, "one JSON object per route")
        parser.epilog = (
            "the counters are those of the gateways that answer here\n\n"
            "example:\n  zacoustic route show router.json5"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print them.

        Raises:
            ConfigError: The file is wrong.
            SessionError: No router is at --connect.
        """
        from zacoustic.app.tools.field.routes import shown_routes
        from zacoustic.app.tools.fleetfile import read_fleet

        config = read_fleet(arguments.config)
        routes = asyncio.run(shown_routes(config, arguments.connect))
        for each in routes:
            if arguments.json:
                print_json(each)
            else:
                print_text(_route_text(each))
        if not routes and not arguments.json:
            print_text("no routes: each node hears each other one, or nothing is measured yet")
        return EXIT_OK


class ProbeRoutes(Command):
    """Measures who hears whom, and proposes routes."""

    name = "probe"
    summary = "measure the loss of every pair of nodes, propose routes"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare nodes, number of probes, path and time limit."""
        parser.epilog = _PROBE_EXAMPLE
        add_node_arguments(parser)
        parser.add_argument(
            "--count", type=int, default=8, metavar="N",
            help="probes of each node, 1..32 (default: %(default)d)",
        )  # fmt: skip
        parser.add_argument(
            "--node", metavar="A,B,…", help="only these addresses (default: all nodes of --config)"
        )
        parser.add_argument(
            "--timeout", type=float, default=60.0, metavar="S",
            help="how long to try each hop of a question, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--seed", type=int, metavar="N", help="draws the number of the run (default: random)"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Measure; exit code 3 if no other node has answered.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, LocalError: No node asks here.
        """
        from zacoustic.app.tools.fleetfile import read_fleet
        from zacoustic.core.wire.relay import MOST_PROBES

        check_positive(arguments, "timeout")
        if arguments.timeout > _LONGEST_S:
            raise ConfigError(f"--timeout {arguments.timeout:g}; allowed: at most {_LONGEST_S:g}")
        if not 1 <= arguments.count <= MOST_PROBES:
            raise ConfigError(f"--count {arguments.count}; allowed: 1..{MOST_PROBES}")
        config = None if arguments.config is None else read_fleet(arguments.config)
        nodes = _nodes(arguments.node, config)
        found = asyncio.run(_survey(arguments, config, nodes))
        proposed = _proposed(found, config)
        if arguments.json:
            print_json(_record(found, proposed))
        else:
            print_text(_survey_text(found, proposed))
        return EXIT_OK if len(found.over) > 1 else EXIT_TIMED_OUT


class SetRoute(Command):
    """Gives a route another path."""

    name = "set"
    summary = "give a route another path, without a restart"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare route, path, nodes, and where to ask."""
        _add_change(parser)
        parser.add_argument(
            "--path", required=True, metavar="A,B,…",
            help="addresses from one end to the other; the ends are those of the file",
        )  # fmt: skip
        parser.epilog = (
            "all nodes are asked first: if one does not answer, nothing changes. Then the relays\n"
            "are told, then the ends, so that no frame is lost on the way. It survives a restart\n"
            "of nodes with a journal; each executes it for the node before it on the path\n\n"
            "example:\n  zacoustic route set 1 --path 1,4,3 --config router.json5"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Change it; exit code 3 if a node has not answered in time, 1 if one refuses.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, ServiceError, CallTimeoutError: Nothing has changed.
        """
        from zacoustic.core.wire.routing import check_path

        path = tuple(_addresses("path", arguments.path))
        try:
            check_path(path)
        except ValueError as error:
            raise ConfigError(f"--{error}") from None
        return _change(arguments, path)


class ResetRoute(Command):
    """Gives a route the path of the file again."""

    name = "reset"
    summary = "give a route the path of the file again"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare route, nodes, and where to ask."""
        _add_change(parser)
        parser.epilog = "example:\n  zacoustic route reset 1 --config router.json5"

    def run(self, arguments: argparse.Namespace) -> int:
        """Reset it; exit codes as of `set`.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, ServiceError, CallTimeoutError: Nothing has changed.
        """
        return _change(arguments, None)


def _add_change(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("id", type=int, metavar="ID", help="number of the route in the file")
    add_node_arguments(parser)
    parser.add_argument(
        "--node", metavar="A,B,…", help="only these addresses (default: all of the path)"
    )
    parser.add_argument(
        "--timeout", type=float, default=60.0, metavar="S",
        help="how long to try each hop of a question, s (default: %(default)g)",
    )  # fmt: skip


def _change(arguments: argparse.Namespace, path: tuple[int, ...] | None) -> int:
    from zacoustic.app.tools.fleetfile import read_fleet

    check_positive(arguments, "timeout")
    if arguments.timeout > _LONGEST_S:
        raise ConfigError(f"--timeout {arguments.timeout:g}; allowed: at most {_LONGEST_S:g}")
    if arguments.config is None:
        raise ConfigError("--config is missing; allowed: the file with the route")
    config = read_fleet(arguments.config)
    routes = {each.route_id: each for each in config.rules.routes}
    if arguments.id not in routes:
        known = ", ".join(map(str, routes)) or "none, the file has no routes"
        raise ConfigError(f"ID {arguments.id}; allowed: {known}")
    route = routes[arguments.id]
    if path is not None and (path[0], path[-1]) != (route.path[0], route.path[-1]):
        raise ConfigError(
            f"--path {arguments.path}; allowed: from {route.path[0]} to {route.path[-1]}, as in "
            "the file"
        )
    listed = config.table.nodes
    for each in path or ():
        if listed and each not in listed:
            raise ConfigError(f"--path {arguments.path}: no node {each} in the file")
    nodes = [] if arguments.node is None else _addresses("node", arguments.node)
    taken = [*routes, *(each.number for each in config.rules.bonds)]
    changed = asyncio.run(_changed(arguments, config, path, route.path, nodes, taken))
    if arguments.json:
        print_json(changed)
    else:
        print_text(_changed_text(changed))
    if not changed.failed:
        return EXIT_OK
    return EXIT_TIMED_OUT if changed.timed_out else EXIT_FAILED


async def _changed(
    arguments: argparse.Namespace,
    config: "Config",
    path: tuple[int, ...] | None,
    of_file: tuple[int, ...],
    nodes: "Sequence[int]",
    taken: "Sequence[int]",
) -> "PathChanged":
    from zacoustic.app.tools.field.changing import change_path

    async with _asker(arguments, config) as asker:
        return await change_path(
            asker,
            arguments.id,
            of_file if path is None else path,
            undo=path is None,
            nodes=nodes,
            taken=taken,
            timeout_s=arguments.timeout,
            tell=print_note,
        )


def _changed_text(changed: "PathChanged") -> str:
    path = " - ".join(map(str, changed.path))
    if not changed.failed:
        return f"route {changed.route}: {path}, revision {changed.revision}, at all nodes asked"
    done = ", ".join(map(str, changed.done)) or "no node"
    return (
        f"route {changed.route}: {path}: {changed.why}; told: {done}. Both paths still work; give "
        "the command again"
    )


async def _survey(
    arguments: argparse.Namespace, config: "Config | None", nodes: "Sequence[int]"
) -> "Survey":
    from zacoustic.app.tools.field.probing import survey

    async with _asker(arguments, config) as asker:
        return await survey(
            asker,
            nodes,
            count=arguments.count,
            timeout_s=arguments.timeout,
            rng=random.Random(arguments.seed),
            tell=print_note,
        )


@contextlib.asynccontextmanager
async def _asker(arguments: argparse.Namespace, config: "Config | None") -> "AsyncIterator[Asker]":
    from zacoustic.app.tools.field.asking import local_gateways
    from zacoustic.app.tools.field.routes import GatewayAsker, LinkAsker

    if arguments.link is None:
        async with local_gateways(config, arguments.connect) as gateways:
            yield GatewayAsker(gateways)
    else:
        async with make_node(arguments) as own:
            yield LinkAsker(own)


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
        if address is None or not 1 <= address <= _MOST_NODES:
            allowed = f"addresses 1..{_MOST_NODES}, with commas"
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
