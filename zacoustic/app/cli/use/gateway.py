"""The verb `zacoustic run gateway`: joins the local Zenoh network to the others."""

import argparse
import asyncio
import logging
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.arguments import OBJECT_PER_LINE, add_json, add_node_file
from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.errors import ConfigError, ZacousticError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, EXIT_USAGE, Command
from zacoustic.link.serving import run_until_stopped
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.zenoh.gateway import Gateway, Notice

_logger = logging.getLogger("zacoustic.gateway")


class GatewayCommand(Command):
    """Runs a gateway from a file; ends cleanly on SIGINT and SIGTERM."""

    name = "gateway"
    summary = "join the Zenoh network here to the others through an acoustic modem"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, address, locator and form of the output."""
        add_node_file(parser)
        parser.add_argument(
            "--listen",
            action="append",
            default=[],
            metavar="ENDPOINT",
            help="where the router or peer listens, instead of the file's; may be repeated",
        )
        parser.add_argument(
            "--journal", metavar="FOLDER", help="where to keep the journal, instead of the file's"
        )
        parser.add_argument(
            "--record", metavar="FILE", help="record everything that crosses, as MCAP"
        )
        add_json(parser, OBJECT_PER_LINE)
        parser.add_argument(
            "--log",
            choices=("text", "json"),
            default="text",
            help="form of the log on standard error; json: what happens as well, and nothing on "
            "standard output without --json (default: %(default)s)",
        )
        parser.add_argument(
            "--metrics", metavar="PLACE",
            help="answer to Prometheus at PORT of this computer, or HOST:PORT, instead of the "
            "file's",
        )  # fmt: skip
        parser.epilog = (
            "the file's mode decides what it is: a router of its own, a peer, or a client of a\n"
            "router that is there; its health is under @acoustic/ADDRESS/** on that network\n\n"
            "example:\n"
            "  zacoustic run gateway router.json5 --address 2 \\\n"
            "    --link evologics/tcp:192.168.0.209:9200"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Run until SIGINT or SIGTERM.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError: A port is in use, no router can be reached, or the address is taken.
            LinkError: The modem cannot be used.
        """
        if arguments.log == "text":
            run_until_stopped(lambda stop: _run(arguments, stop))
            return EXIT_OK
        from zacoustic.app.tools.field.jsonlog import log_as_json

        log_as_json({})
        try:
            run_until_stopped(lambda stop: _run(arguments, stop))
        except ZacousticError as error:  # with --json, the last line is JSON as well
            _logger.error("%s", error)
            return EXIT_USAGE if isinstance(error, ConfigError) else EXIT_FAILED
        return EXIT_OK


async def _run(arguments: argparse.Namespace, stop: asyncio.Event) -> None:
    from zacoustic.app.tools.field.jsonlog import log_as_json
    from zacoustic.config.metrics import metrics_argument
    from zacoustic.zenoh.gateway import Gateway

    def notify(notice: "Notice") -> None:
        if arguments.log == "json":
            _log(notice)
        if arguments.log == "text" or arguments.json:
            try:
                _print(notice, as_json=arguments.json)
            except BrokenPipeError:
                stop.set()

    gateway = Gateway.from_file(
        arguments.file,
        address=arguments.address,
        locator=arguments.link,
        journal=arguments.journal,
        listen=arguments.listen,
        record=arguments.record,
        notify=notify,
        metrics=metrics_argument(arguments.metrics),
    )
    if arguments.log == "json":
        log_as_json({"node": gateway.config.address})
    try:
        await gateway.start()
        await _failure(gateway)
    finally:
        await gateway.close()


async def _failure(gateway: "Gateway") -> None:
    """Wait until a fault stops the gateway, and report it in one line."""
    try:
        await gateway.wait_failed()
    except ZacousticError:
        raise
    except Exception as error:  # any error that has stopped it
        hint = "the traceback is above; please report it"
        raise ZacousticError(f"stopped by a fault: {error!r}", hint=hint) from error


def _log(notice: "Notice") -> None:
    """Log a notice, with its fields."""
    from zacoustic.app.tools.field.jsonlog import FIELDS

    level = logging.WARNING if notice.is_trouble else logging.INFO
    text = ", ".join(" ".join(line.split()) for line in notice.lines())
    _logger.log(level, "%s", text, extra={FIELDS: notice.record()})


def _print(notice: "Notice", *, as_json: bool) -> None:
    if as_json:
        print_json(notice.record(), flush=True)
    else:
        print_text("\n".join(map(one_line, notice.lines())), flush=True)
