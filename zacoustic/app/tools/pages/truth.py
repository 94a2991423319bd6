"""Keeps a page true when something dies; `webpage.Banner` puts it onto a page of NiceGUI's.

A browser shows its last contents for ever. So each page beats: a number in it changes, and a script
there (`truth.js`) that misses the beat shows a banner over the whole width, within three seconds,
greys the values, and refuses clicks that nobody would get. The same banner shows what the server
knows to have failed. Ages count in the browser: an element with ``data-age`` (seconds, when it was
sent) shows its present age.
"""

import math
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.text.safetext import html_text

SCRIPT: Final = Path(__file__).with_name("truth.js").read_text(encoding="utf-8")
"""Runs in the browser."""
STYLE: Final = """
#za-banner { position: fixed; top: 0; left: 0; right: 0; z-index: 9999; padding: 8px 14px;
  background: #c40f1c; color: #fff; font-size: 17px; font-weight: 700; white-space: pre-line;
  text-align: center; }
#za-banner[hidden] { display: none; }
.nicegui-content { padding-top: var(--za-banner, 0px) !important; }
.q-header { top: var(--za-banner, 0px) !important; }
body.za-gone .za-live { opacity: .4; filter: grayscale(1); cursor: not-allowed; }
"""
"""Of the banner, and of values (class ``za-live``) that are not kept up to date."""


class Alarm(msgspec.Struct, frozen=True):
    """Something dead that makes the display or the buttons untrue."""

    text: str
    """What, in a few words."""
    since_s: float | None = None
    """How long ago it began, s; None: not known."""


def beat_html(number: int, alarm: Alarm | None, *, what: str, taken: int = 0) -> str:
    """Return what a page must get at least every second.

    Args:
        number: Another one than the last.
        alarm: What the server knows to have failed; None: nothing.
        what: Begins the banner when the server is gone.
        taken: Number of the page's last command that was accepted.
    """
    since = "" if alarm is None or alarm.since_s is None else f"{max(alarm.since_s, 0.0):.1f}"
    return (
        f'<i id="za-beat" data-beat="{number}" data-what="{html_text(what)}" '
        f'data-dead="{"" if alarm is None else html_text(alarm.text)}" data-since="{since}" '
        f'data-taken="{taken}"></i>'
    )


def age_html(seconds: float, text: str, *, form: str = "long") -> str:
    """Return an age that counts in the browser.

    Args:
        seconds: How old it is now, s.
        text: The same in words, until the browser counts.
        form: ``long``, as ``1 min 46 s``, or ``short``, as ``2 min``.
    """
    if not math.isfinite(seconds):
        return html_text(text)
    return f'<span data-age="{max(seconds, 0.0):.1f}" data-form="{form}">{html_text(text)}</span>'
