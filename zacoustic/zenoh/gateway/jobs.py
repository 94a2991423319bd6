"""The jobs of a gateway for a stream on the local network; `routes` makes their declarations."""

from typing import Final

FORWARD: Final = "forward"
DELIVER: Final = "deliver"
PROXY: Final = "proxy"
SERVE: Final = "serve"
ATTEND: Final = "attend"
WATCH: Final = "watch"
