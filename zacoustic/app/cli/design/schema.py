"""The verb `zacoustic config schema`."""

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.support.rows import flag, word
from zacoustic.app.cli.support.verb import Verb


class Schema(Verb):
    """Every key of the configuration, what it takes and what it means.

    Example:
      zacoustic config schema 'streams (topic)'
    """

    prints_late = False

    table: str | None = word("TABLE", "one table, such as links (default: a list)", "?")
    markdown: bool = flag("all as the page of the docs", either="form")
    json: bool = flag("all as a JSON Schema, for an editor", either="form")

    def work(self) -> None:
        """Print it.

        Raises:
            ConfigError: There is no such table.
        """
        from zacoustic.app.tools.design import reference

        if self.json:
            print_json(reference.json_schema())
        elif self.markdown:
            print_text(reference.as_markdown(reference.tables()).removesuffix("\n"))
        elif self.table is not None:
            print_text(reference.as_text(reference.table_named(self.table)))
        else:
            print_text(reference.list_of_tables(reference.tables()))
