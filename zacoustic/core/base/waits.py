"""Why a frame waits, one word a reason."""

import enum

import msgspec


class Why(enum.Enum):
    """The reason for which the next frame of a link waits."""

    LINK = "link"
    """The link is not up."""
    MODEM = "modem"
    """The modem transmits, or needs the gap after its last frame."""
    JOURNAL = "journal"
    """The boot epoch is not journalled yet, or frames cannot be sealed."""
    LINGER = "linger"
    """Its payload lingers, so that others may join its frame."""
    INTERVAL = "interval"
    """The minimum interval of its stream has not passed."""
    REPLIES = "replies"
    """The node that it answers has used up its reply budget."""
    ANSWER = "answer"
    """This node listens for feedback about the object that it sends."""
    AIRTIME = "airtime"
    """The airtime cap of the node, or of its stream, is spent."""
    BURST = "burst"
    """Another node sends this one burst data, and hears nothing meanwhile."""
    PAUSE = "pause"
    """This node pauses so that others can reach it, or waits for the pause of another node."""
    CARRIER = "carrier"
    """Another node is heard."""
    BACK_OFF = "back-off"
    """The random wait after a carrier, or after a loss."""
    SLOT = "slot"
    """Its next own slot has not begun."""
    CLOCK = "clock"
    """The time is not known well enough to use slots."""
    TURN = "turn"
    """Another node has the turn."""
    SILENCE = "silence"
    """Silence is commanded, or there is a quiet window."""


class Waits(msgspec.Struct, frozen=True, kw_only=True):
    """A frame that waits."""

    why: Why
    """The reason that holds it longest."""
    until: int | None
    """Instant at which it goes if nothing else happens, ns; None: an input must come first."""
