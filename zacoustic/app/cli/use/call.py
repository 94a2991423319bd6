"""The verb `zacoustic service call`: calls a service and prints the answer."""

import argparse
import asyncio
from typing import Any

from zacoustic.app.cli.support.arguments import check_positive
from zacoustic.app.cli.support.participant import (
    add_node_arguments,
    class_of,
    make_node,
    print_value,
    read_request,
)
from zacoustic.link.command import EXIT_OK, Command

_EXAMPLE = """examples:
  zacoustic service call auv1/arm '{ on: true }' --connect tcp/127.0.0.1:7447
  zacoustic service call auv1/arm '{ on: true }' --link sim/127.0.0.1:7000 \\
    --config fleet.json5 --timeout 30
"""


class CallCommand(Command):
    """Calls a service once."""

    name = "call"
    summary = "call a service, on Zenoh or straight on a link"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare service, request, where to, how long to wait."""
        parser.epilog = _EXAMPLE
        parser.add_argument("key", metavar="SERVICE", help="service of the config, or key")
        parser.add_argument(
            "request", metavar="REQUEST", nargs="?", default="",
            help="JSON5 for a typed service, otherwise a text",
        )  # fmt: skip
        add_node_arguments(parser)
        parser.add_argument(
            "--timeout", type=float, metavar="S",
            help="how long to wait for the answer, s (default: the config's, or 60)",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Call and print the answer; exit code 3 if none comes in time.

        Raises:
            ServiceError, DeliveryError: There is no response.
        """
        check_positive(arguments, "timeout")
        return asyncio.run(_call(arguments))


async def _call(arguments: argparse.Namespace) -> int:
    from zacoustic.zenoh.node.api.text import read_untyped

    async with make_node(arguments) as node:
        stream = node.find_stream(arguments.key)
        types: tuple[Any, Any] = (bytes, bytes)
        if stream is None:
            request, _ = read_untyped(arguments.request, source="REQUEST")
        else:
            request = read_request(stream, arguments.request, source="REQUEST")
            types = (class_of(stream.type), class_of(stream.response_type))
        client = node.create_client(types, arguments.key)
        response = await client.call(request, timeout_s=arguments.timeout)
    print_value({"key": arguments.key}, response, as_json=arguments.json)
    return EXIT_OK
