"""The verb `zacoustic config doctor`."""

from zacoustic.app.cli.host.examined import Examined
from zacoustic.app.cli.support.rows import modem_profile, repeated, seconds
from zacoustic.link.command import EXIT_FAILED, EXIT_OK


class Doctor(Examined):
    """Find what would go wrong at sea, with the cure.

    nothing is transmitted, and nothing is set. Where a gateway of this node runs
    already, doctor asks it instead of its modem. Exits with 1 when something is wrong;
    docs/doctor.md lists the checks

    Example:
      zacoustic config doctor router.json5 --address 2 --ntp pool.ntp.org
    """

    recording: list[str] = repeated("RECORDING", "rates for the airtime")
    profile: str | None = modem_profile(" of the airtimes")
    patience: float | None = seconds("how long a modem may take to come, s (10)")

    async def work(self) -> int:
        """Print the faults; fails if there are any.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        import msgspec

        from zacoustic.app.tools.design.plan.fleet import AssumedChannel
        from zacoustic.app.tools.field.doctor.doctor import DEFAULT_PATIENCE_S, diagnose
        from zacoustic.app.tools.field.doctor.text import as_text
        from zacoustic.channel.profiles import DEFAULT_PROFILE

        options = msgspec.structs.replace(
            self.options(),
            recordings=tuple(self.recording),
            channel=AssumedChannel(profile=self.profile or DEFAULT_PROFILE),
            patience_s=self.patience or DEFAULT_PATIENCE_S,
        )
        report = await diagnose(self.file, options)
        self.show(report, as_text)
        return EXIT_FAILED if report.findings else EXIT_OK
