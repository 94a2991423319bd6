"""The verb `zacoustic dashboard`: gateways as a web page."""

import argparse
import contextlib

from zacoustic.app.cli.support.printing import print_line
from zacoustic.app.cli.watch.topics import add_watch_arguments, read_watch
from zacoustic.link.command import EXIT_OK, Command
from zacoustic.link.serving import parse_place, place_name

_EXAMPLE = """It shows what zacoustic monitor shows, and needs no internet. Anybody who reaches the
place can read it: there is no password. It costs no airtime. Ctrl-C ends it.

examples:
  zacoustic dashboard --connect tcp/127.0.0.1:7447
  zacoustic dashboard --config router.json5 --listen 0.0.0.0:8090
"""


class DashboardCommand(Command):
    """Serves a page about gateways."""

    name = "dashboard"
    summary = "watch gateways on a web page: what zacoustic monitor shows, and its history"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare gateways, their network, and the place of the page."""
        parser.epilog = _EXAMPLE
        add_watch_arguments(parser)
        parser.add_argument(
            "--listen", default="127.0.0.1:8090", metavar="HOST:PORT",
            help="where the page is; port 0: any that is free (default: %(default)s)",
        )  # fmt: skip

        parser.add_argument(
            "--name", action="append", default=[], metavar="HOST",
            help="answer to browsers that find it under this name as well; addresses and this "
            "computer's own name are always good; may be given again",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Serve until Ctrl-C.

        Raises:
            ConfigError: An argument or the file is wrong.
            LinkOpenError: The place cannot be used.
        """
        with contextlib.suppress(KeyboardInterrupt):
            _serve(arguments)
        return EXIT_OK


def _serve(arguments: argparse.Namespace) -> None:
    from zacoustic.app.tools.watch.lookout import Lookout
    from zacoustic.app.tools.watch.serving import free_place, serve
    from zacoustic.app.tools.watch.watching import Watch

    host, port = parse_place(arguments.listen)
    port = free_place(host, port)
    config = read_watch(arguments)

    def make() -> Watch:
        return Watch(config, arguments.connect)

    where = ", ".join(arguments.connect or [arguments.config or "this network"])
    url = f"http://{place_name(host, port)}"
    print_line({"url": url}, f"page      {url}", as_json=arguments.json)
    serve(Lookout(make, where, arguments.node), host, port, arguments.name)
