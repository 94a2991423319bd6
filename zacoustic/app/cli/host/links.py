"""The verb `zacoustic links`."""

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.support.rows import flag
from zacoustic.app.cli.support.verb import Verb
from zacoustic.link.command import EXIT_FAILED, EXIT_OK
from zacoustic.text.installing import OURSELVES


class Links(Verb):
    """List the installed links, their settings, and whether they can be used.

    Example:
      zacoustic links
    """

    json: bool = flag("one JSON object for all of them")

    def work(self) -> int:
        """Print them; fails if there is none."""
        from zacoustic.app.tools.field.links import describe_as_text
        from zacoustic.errors import LinkUnavailableError
        from zacoustic.link import registry

        links = registry.describe()
        if self.json:
            print_json({"links": links})
            return EXIT_OK if links else EXIT_FAILED
        if not links:
            raise LinkUnavailableError("no links are installed", hint=OURSELVES)
        print_text(describe_as_text(links))
        return EXIT_OK
