"""Shows on a page that its data are stale; `webpage.Banner` puts it onto a page of NiceGUI.

A browser shows its last contents for ever. So each page has a heartbeat: a changing number, watched
by a script (`truth.js`). If it stops, the script shows a banner over the whole width within three
seconds, greys the values, and refuses clicks that would be lost. The same banner shows failures
known to the server. Ages count in the browser: an element with ``data-age`` (seconds, when it was
sent) shows its present age.
"""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.text.safetext import html_text

SCRIPT: Final = Path(__file__).with_name("truth.js").read_text(encoding="utf-8")
"""The script for the browser."""
STYLE: Final = """
#za-banner { position: fixed; top: 0; left: 0; right: 0; z-index: 9999; padding: 8px 14px;
  background: #c40f1c; color: #fff; font-size: 17px; font-weight: 700; white-space: pre-line;
  text-align: center; }
#za-banner[hidden] { display: none; }
#za-banner button { margin-left: 14px; padding: 2px 12px; border: 1px solid #fff;
  border-radius: 4px; background: transparent; color: #fff; font: inherit; font-size: 14px;
  cursor: pointer; }
.nicegui-content { padding-top: var(--za-banner, 0px) !important; }
.q-header { top: var(--za-banner, 0px) !important; }
body.za-gone .za-live { opacity: .4; filter: grayscale(1); cursor: not-allowed; }
"""
"""Style of the banner, and of stale values (class ``za-live``)."""


class Alarm(msgspec.Struct, frozen=True):
    """A failure that makes the display or the buttons wrong."""

    text: str
    """Description in a few words."""
    since_s: float | None = None
    """Time since its beginning, s; None: unknown."""


def beat_html(number: int, alarm: Alarm | None, *, what: str, taken: Iterable[str] = ()) -> str:
    """Return the heartbeat, which a page must get at least every second.

    Args:
        number: A number different from the last one.
        alarm: A failure known to the server; None: none.
        what: Beginning of the banner when the server is gone.
        taken: Ids of the newest accepted commands, without spaces.
    """
    since = "" if alarm is None or alarm.since_s is None else f"{max(alarm.since_s, 0.0):.1f}"
    return (
        f'<i id="za-beat" data-beat="{number}" data-what="{html_text(what)}" '
        f'data-dead="{"" if alarm is None else html_text(alarm.text)}" data-since="{since}" '
        f'data-taken="{html_text(" ".join(taken))}"></i>'
    )


def age_html(seconds: float, text: str, *, form: str = "long") -> str:
    """Return an age that counts in the browser.

    Args:
        seconds: Its present value, s.
        text: The same in words, until the browser counts.
        form: ``long``, as ``1 min 46 s``, or ``short``, as ``2 min``.
    """
    if not math.isfinite(seconds):
        return html_text(text)
    return f'<span data-age="{max(seconds, 0.0):.1f}" data-form="{form}">{html_text(text)}</span>'
