"""Plots of a page: SVG inside it, with its colours. Needs matplotlib."""

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import msgspec

from zacoustic.errors import ConfigError
from zacoustic.text.installing import with_extra
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH_IN: Final = 9.0
_HEIGHT_IN: Final = 2.8
_LABEL_CHARACTERS: Final = 40

# Placeholder for the colour of the page's text, which only the browser knows.
_INK: Final = "#010203"
_INKED: Final = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color",
                 "grid.color")  # fmt: skip
_LOOK: Final[dict[Any, Any]] = {
    **dict.fromkeys(_INKED, _INK),
    **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), "none"),
    "legend.framealpha": 0.0,
    "svg.fonttype": "none",
    "font.size": 9,
    "text.parse_math": False,  # a dollar in a name is no formula
}


class Plot(msgspec.Struct, frozen=True):
    """One plot."""

    title: str
    """Its title."""
    svg: str
    """The picture."""


def need_matplotlib(extra: str) -> None:
    """Check that matplotlib is installed.

    Args:
        extra: Our extra that includes it.

    Raises:
        ConfigError: It is not.
    """
    try:
        import matplotlib.figure  # noqa: F401 (tests that it is installed)
    except ImportError as error:
        raise ConfigError(
            f"a page needs {error.name}",
            hint=with_extra(extra),
        ) from error


def draw(title: str, fill: "Callable[[Axes], bool]") -> Plot | None:
    """Draw one plot; None without data.

    Args:
        title: Its title.
        fill: Draws into the axes; False: there is nothing to draw.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({**_LOOK, "svg.hashsalt": title}):
        figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN), layout="constrained")
        axes = figure.add_subplot()
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        if not fill(axes):
            return None
        written = io.StringIO()
        figure.savefig(written, format="svg", metadata={"Date": None, "Creator": None})
    text = written.getvalue().replace(_INK, "currentColor")
    return Plot(title, text[text.index("<svg") :])


def label(name: str) -> str:
    """Return a name for a plot: short and safe."""
    shown = one_line(name)
    return shown if len(shown) <= _LABEL_CHARACTERS else f"{shown[: _LABEL_CHARACTERS - 1]}…"
