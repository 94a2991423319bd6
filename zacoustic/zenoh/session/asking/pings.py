"""A ping as a Zenoh key: the query, and the JSON of its answer.

A `get` on ``@acoustic/2/ping?within_s=30`` makes the local gateway ping node 2, whose engine
answers without its application. With ``status=true`` the answer contains node 2's report on its
journal, clock and medium access.
"""

from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.core.streams.commands import COMMANDS_TIMEOUT_S
from zacoustic.zenoh.session.asking.commands import ANY_NODE, PREFIX, node_in, time_limit_s

DEFAULT_PING_S: Final = 30.0
"""Default time limit of an answer, s."""
PINGS: Final = f"{PREFIX}/{ANY_NODE}/ping"
"""Key expression of the pings of all nodes."""
LINK_DOWN: Final = "the link is down"
"""Within the text of an error: nothing could be sent when the time was over."""
_FLAGS: Final = {"true": True, "false": False}


class PeerStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The status that a node reports, compared with the asking gateway."""

    journal: str
    """`kept`; `none`; `doubted`: damaged, or an old copy; `failing`: it cannot be written now."""
    starts: int
    """Starts of the node that its journal has recorded, including this one; 0: none."""
    clock_ahead_s: float | None = None
    """How far its clock is ahead of the gateway's, s; None: one of the two is unknown."""
    clock_doubt_s: float | None = None
    """Uncertainty of that comparison, s."""
    clock_error_s: float | None = None
    """Largest error of its clock as it reports it, s; None: nothing synchronises the clock."""
    range_m: int | None = None
    """Range to this node as the other node's modem has measured it, m."""
    same_schedule: bool = True
    """Its slots or turns are the same as here."""


class PingAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a ping."""

    address: int
    """Address of the pinged node."""
    by: int
    """Address of the pinging node."""
    round_trip_s: float | None = None
    """Time from the query, through queue and channel, to the node's answer; None: the wire profile
    has no such query, and only the range was measured."""
    propagation_s: float | None = None
    """One way, s, as the modem measured it last; None: it measures none."""
    range_m: float | None = None
    """Slant distance, m; None: the modem knows no sound speed."""
    range_age_s: float | None = None
    """Age of that measurement, s."""
    snr_db: float | None = None
    """Signal-to-noise ratio of its last frame, dB."""
    received_level_db: float | None = None
    """Received level, dB, by the modem's own reference."""
    integrity: float | None = None
    """Signal quality in the modem's own scale."""
    status: PeerStatus | None = None
    """The node's reported status; None: not requested, or refused."""


class PingAsked(msgspec.Struct, frozen=True, kw_only=True):
    """A ping in a query."""

    node: int
    """Address of the node to ping."""
    within_s: float = DEFAULT_PING_S
    """Time limit of an answer, s."""
    status: bool = False
    """Whether to request the node's status."""


def ping_selector(node: int, within_s: float, *, status: bool = False) -> tuple[str, str]:
    """Return key and parameters of a ping."""
    return f"{PREFIX}/{node}/ping", f"within_s={within_s:.10g}{';status=true' if status else ''}"


def read_ping(key: str, parameters: Mapping[str, str]) -> PingAsked | None:
    """Read a ping.

    Returns:
        The ping, or None: the key browses.

    Raises:
        ValueError: Names a parameter, its value and the allowed values.
    """
    node = node_in(key, "ping")
    if node is None:
        return None
    status = False
    for name, text in parameters.items():
        if name.startswith("_"):
            continue
        if name == "status":
            if text not in _FLAGS:
                raise ValueError(f"status is {text}; allowed: {', '.join(_FLAGS)}")
            status = _FLAGS[text]
        elif name != "within_s":
            raise ValueError(f"{name} is no parameter of {key}; allowed: within_s, status")
    within_s = time_limit_s(parameters, DEFAULT_PING_S, COMMANDS_TIMEOUT_S)
    return PingAsked(node=node, within_s=within_s, status=status)
