"""Passes what frames say about the medium to the port on which they came."""

from zacoustic.core.peers.reception import Heard, Reception
from zacoustic.core.wire.access import ANYBODY, AccessControl, ClockTime, Turn
from zacoustic.core.wire.objects import Fragment


def hear_medium(reception: Reception) -> None:
    """Register for controls of medium access and listen hints, also in overheard frames.

    Args:
        reception: Dispatches them. Components that take fragments register later.
    """
    reception.on(ClockTime, _control)
    reception.on(Turn, _control)
    reception.on(Fragment, _listen_hint)
    reception.overhear(Turn, _turn_of_others)
    reception.overhear(Fragment, _listen_hint)


def _control(heard: Heard, control: AccessControl) -> None:
    heard.port.handle_control(heard.source, control, heard.frame, heard.now)


def _turn_of_others(heard: Heard, turn: Turn) -> None:
    if turn.node == ANYBODY:
        _control(heard, turn)


def _listen_hint(heard: Heard, fragment: Fragment) -> None:
    heard.port.handle_call(heard.source, fragment.call, heard.frame, heard.now)
