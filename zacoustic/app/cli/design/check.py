"""The verb `zacoustic config check`."""

from zacoustic.app.cli.support.rows import modem_profile
from zacoustic.app.cli.support.verb import LinkedVerb
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, EXIT_USAGE


class Check(LinkedVerb):
    """Validate a configuration and show bytes and airtime of every stream.

    exits with 1 when the file is valid, and its link or its key file cannot be used on
    this computer, or something in it can never cross; with 2 when it is not valid

    Example:
      zacoustic config check fleet.json5 --address 2
    """

    profile: str | None = modem_profile(" of the airtimes")

    def work(self) -> int:
        """Print the report; fails if a link is unusable here, or a stream never crosses.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        from zacoustic.app.tools.design.check.report import report_of
        from zacoustic.app.tools.design.check.text import as_text
        from zacoustic.app.tools.security.keyrefusals import key_refusals
        from zacoustic.channel.profiles import profile_named
        from zacoustic.config import read_config

        profile = profile_named(self.profile) if self.profile else None
        config = read_config(self.file, address=self.address, locator=self.link)
        report = report_of(config, profile)
        self.show(report, as_text)
        wrong, fails = False, bool(report.misfits)
        for index, link in enumerate(report.links):
            if link.error:
                key = f"{self.file}: plugins.acoustic.links[{index}].locator"
                self.note(f"{'--link' if self.link else key}: {link.error}")
                wrong, fails = wrong or link.is_wrong, True
        for refusal in key_refusals(config):
            self.note(refusal)
            fails = True
        return EXIT_USAGE if wrong else EXIT_FAILED if fails else EXIT_OK
