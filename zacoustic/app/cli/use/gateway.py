"""The verb `zacoustic run gateway`."""

import logging
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.rows import OBJECT_PER_LINE, flag, option, repeated
from zacoustic.app.cli.support.verb import LinkedVerb
from zacoustic.errors import ConfigError, ZacousticError
from zacoustic.link.command import EXIT_FAILED, EXIT_USAGE
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    import argparse

    from zacoustic.zenoh.gateway import Gateway, Notice

_logger = logging.getLogger("zacoustic.gateway")


class RunGateway(LinkedVerb):
    r"""Join the Zenoh network here to the others through an acoustic modem.

    the file's mode decides what it is: a router of its own, a peer, or a client of a
    router that is there; its health is under @acoustic/ADDRESS/** on that network

    Example:
      zacoustic run gateway router.json5 --address 2 \
        --link evologics/tcp:192.168.0.209:9200
    """

    prints_late = False
    runs_on = True

    listen: list[str] = repeated(
        "ENDPOINT", "where the router or peer listens, instead of the file's"
    )
    journal: str | None = option("FOLDER", "where to keep the journal, instead of the file's")
    record: str | None = option("FILE", "record everything that crosses, as MCAP")
    log: str = option(
        None,
        "form of the log on standard error; json: what happens as well, and nothing on "
        "standard output without --json",
        "text",
        choices=("text", "json"),
    )
    metrics: str | None = option(
        "PLACE",
        "answer to Prometheus at PORT of this computer, or HOST:PORT, instead of the file's",
    )
    json: bool = flag(OBJECT_PER_LINE)

    def run(self, arguments: "argparse.Namespace") -> int:
        """Run until SIGINT or SIGTERM."""
        if arguments.log == "text":
            return super().run(arguments)
        from zacoustic.app.tools.field.jsonlog import log_as_json

        log_as_json({})
        try:
            return super().run(arguments)
        except ZacousticError as error:  # with --json, the last line is JSON as well
            _logger.error("%s", error)
            return EXIT_USAGE if isinstance(error, ConfigError) else EXIT_FAILED

    async def work(self) -> None:
        """Run until SIGINT or SIGTERM.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError: A port is in use, no router can be reached, or the address is taken.
            LinkError: The modem cannot be used.
        """
        from zacoustic.app.tools.field.jsonlog import log_as_json
        from zacoustic.config.metrics import metrics_argument
        from zacoustic.zenoh.gateway import Gateway

        gateway = Gateway.from_file(
            self.file,
            address=self.address,
            locator=self.link,
            journal=self.journal,
            listen=self.listen,
            record=self.record,
            notify=self._tell,
            metrics=metrics_argument(self.metrics),
        )
        if self.log == "json":
            log_as_json({"node": gateway.config.address})
        try:
            await gateway.start()
            await _failure(gateway)
        finally:
            await gateway.close()

    def _tell(self, notice: "Notice") -> None:
        if self.log == "json":
            _log(notice)
        if self.log == "text" or self.json:
            self.tell(notice.record(), "\n".join(map(one_line, notice.lines())))


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
