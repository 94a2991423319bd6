"""Public names for a web page that operators trust: `zacoustic.app.tools.pages`.

A page that says when what it shows is stale. The pages of `zacoustic dashboard` and of
`examples/auv` are made with these. `Banner` and `serve_page` need NiceGUI, the extra `console`, and
are imported on first use.
"""

from typing import TYPE_CHECKING, Any

from zacoustic.app.tools.pages.truth import Alarm, age_html
from zacoustic.text.safetext import html_text, one_line

if TYPE_CHECKING:
    from zacoustic.app.tools.pages.webpage import Banner, serve_page

__all__ = ["Alarm", "Banner", "age_html", "html_text", "one_line", "serve_page"]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name in __all__:
        from zacoustic.app.tools.pages import webpage

        return getattr(webpage, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
