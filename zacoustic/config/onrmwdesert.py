"""`wire: "rmw_desert"`: the keys of the section without a counterpart on that wire."""

from typing import Final

from zacoustic.config.problems import Place, shown
from zacoustic.config.sections import Section
from zacoustic.core.schedule.access.spec import AccessSpec, PollingSpec, slots_of
from zacoustic.core.streams.wireprofile import WireProfile

_WIRE: Final = f'wire: "{WireProfile.RMW_DESERT.value}"'
_REASONS: Final = {
    "agreement": "its ends do not compare their tables",
    "heartbeat_s": "nothing on it says that a node is there",
    "lost_after_s": "nothing on it says who sends",
    "lost_contact": "nothing on it says who sends",
    "ranging": "nothing on it asks a modem for a range",
    "commands_from": "no commands cross it",
    "objects": "what is larger than a packet does not cross",
    "security": "its packets have no room for a seal, and its other programs no key",
    "routes": "its frames name no route",
    "relay": "its frames name no route",
    "flood": "nobody passes its packets on",
    "default_links": "it has one link",
    "model": "no stream is dense on it",
}


def check_section(place: Place, written: Section) -> None:
    """Refuse keys of the section that have no counterpart on this wire.

    Args:
        place: The section.
        written: Its content.

    Raises:
        ConfigError: There is such a key; the message names the first.
    """
    for key, reason in _REASONS.items():
        if getattr(written, key) not in (None, ()):
            _refuse(place.at(key), reason)
    for index, node in enumerate(written.nodes):
        for key in ("heartbeat_s", "lost_after_s"):
            if getattr(node, key) is not None:
                _refuse(place.at("nodes").at(index).at(key), _REASONS[key])


def check_access(place: Place, access: AccessSpec | None) -> None:
    """Refuse medium access that needs controls of its own.

    Args:
        place: Place of the table `access`.
        access: Its content.

    Raises:
        ConfigError: This wire does not have such controls.
    """
    if isinstance(access, PollingSpec):
        place.at("method").refuse(
            f'"polling" with {_WIRE}: its turns are told in frames of the native wire',
            allowed='"aloha", "carrier_sense", "tdma", "delegated"',
        )
    slots = slots_of(access)
    if slots is not None and slots.clock is not None:
        place.at("clock").refuse(
            f"{slots.clock} with {_WIRE}: the time is told in frames of the native wire",
            allowed="none, UTC then",
        )


def _refuse(place: Place, reason: str) -> None:
    place.refuse(
        f"{shown(place.written)} with {_WIRE}: {reason}",
        allowed="none",
        hint=f"leave {place.path.rpartition('.')[2]} out",
    )
