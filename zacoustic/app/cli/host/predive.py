"""The verb `zacoustic predive`."""

from zacoustic.app.cli.host.examined import Examined
from zacoustic.app.cli.support.rows import repeated, seconds
from zacoustic.link.command import EXIT_FAILED, EXIT_OK


class Predive(Examined):
    """Ask the other nodes through the real links, and compare both ends.

    each other node is asked for its journal, clock and slots; tables, lives and ranges
    are compared, and this computer is examined as by `zacoustic config doctor`.
    The gateway has to run. Exits with 1 when something is wrong, within a minute

    Example:
      zacoustic predive router.json5 --address 1 --node 2
    """

    node: list[int] = repeated("N", "another node (default: all of the file)", type=int)
    timeout: float | None = seconds("how long to wait for the answers, s (40)")

    async def work(self) -> int:
        """Print the results; fails if something is wrong.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        from zacoustic.app.tools.field.predive import DEFAULT_WITHIN_S, as_text, predive

        within_s = self.timeout or DEFAULT_WITHIN_S
        report = await predive(self.file, self.options(), self.node, within_s)
        self.show(report, as_text)
        return EXIT_FAILED if report.findings else EXIT_OK
