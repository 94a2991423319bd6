"""What a gateway can do for a stream locally; `routes` declares what each job needs."""

from typing import Final

FORWARD: Final = "forward"
DELIVER: Final = "deliver"
PROXY: Final = "proxy"
SERVE: Final = "serve"
ATTEND: Final = "attend"
WATCH: Final = "watch"
