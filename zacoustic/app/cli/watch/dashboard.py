"""The verb `zacoustic dashboard`."""

import contextlib

from zacoustic.app.cli.support.rows import option, repeated
from zacoustic.app.cli.watch.watcher import Watcher
from zacoustic.link.serving import parse_place, place_name


class Dashboard(Watcher):
    """Watch gateways on a web page: what zacoustic monitor shows, and its history.

    It shows what zacoustic monitor shows, and needs no internet. Anybody who reaches the
    place can read it: there is no password. It costs no airtime. Ctrl-C ends it.

    Examples:
      zacoustic dashboard --connect tcp/127.0.0.1:7447
      zacoustic dashboard --config router.json5 --listen 0.0.0.0:8090
    """

    prints_late = False

    listen: str = option(
        "HOST:PORT", "where the page is; port 0: any that is free", "127.0.0.1:8090"
    )
    hosts: list[str] = repeated(
        "HOST",
        "answer to browsers that find it under this name as well; addresses and this computer's "
        "own name are always good",
        flags=("--name",),
    )

    def work(self) -> None:
        """Serve until Ctrl-C.

        Raises:
            ConfigError: An argument or the file is wrong.
            LinkOpenError: The place cannot be used.
        """
        from zacoustic.app.tools.watch.lookout import Lookout
        from zacoustic.app.tools.watch.serving import free_place, serve
        from zacoustic.app.tools.watch.watching import Watch

        with contextlib.suppress(KeyboardInterrupt):
            host, port = parse_place(self.listen)
            port = free_place(host, port)
            config = self.fleet()
            where = ", ".join(self.connect or [self.config or "this network"])
            url = f"http://{place_name(host, port)}"
            self.line({"url": url}, f"page      {url}")
            lookout = Lookout(lambda: Watch(config, self.connect), where, self.node)
            serve(lookout, host, port, self.hosts)
