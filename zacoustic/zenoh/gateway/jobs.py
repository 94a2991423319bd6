"""What a gateway can do for a stream on its island; `routes` says what is declared for each job."""

from typing import Final

FORWARD: Final = "forward"
DELIVER: Final = "deliver"
PROXY: Final = "proxy"
SERVE: Final = "serve"
ATTEND: Final = "attend"
WATCH: Final = "watch"
