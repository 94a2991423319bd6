"""The verb `zacoustic config show`."""

import json
from typing import Any

from zacoustic.app.cli.support.verb import LinkedVerb
from zacoustic.text.safetext import without_secrets


class Show(LinkedVerb):
    """The configuration that holds: defaults filled in, arguments applied.

    What it prints is a file again. Keys that have no value by default are left out
    (zacoustic config schema says what that means), and so are Zenoh's part of the file and passwords.

    Examples:
      zacoustic config show fleet.json5 --address 2
      zacoustic config show fleet.json5 --json
    """  # noqa: E501 (wide on a terminal)

    prints_late = False

    def work(self) -> None:
        """Print it.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        from zacoustic.app.tools.design.effective import effective_section

        section = effective_section(self.file, address=self.address, locator=self.link)
        self.show({"plugins": {"acoustic": section}}, _as_text)


def _as_text(whole: dict[str, Any]) -> str:
    return without_secrets(json.dumps(whole, indent=2, ensure_ascii=False))
