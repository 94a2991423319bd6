"""The keys `heartbeat_s` and `lost_after_s`: in the section for all nodes, at a node for itself."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import Section
from zacoustic.core.peers.contact import LEAST_MISSED, ContactRules
from zacoustic.core.peers.lostcontact import LostContactRule


def read_contact(
    place: Place, written: Section, own: int, lost_contact: tuple[LostContactRule, ...] = ()
) -> ContactRules:
    """Read the heartbeat settings of the section at `place`.

    Args:
        place: The section.
        written: Its content.
        own: Address of this node.
        lost_contact: When this node must act because it hears nobody.

    Raises:
        ConfigError: A time is too short for the heartbeats; reports the first.
    """
    _check_pair(place, place, written.heartbeat_s, written.lost_after_s)
    heartbeat_s = written.heartbeat_s
    lost_after_s: dict[int, float] = {}
    for index, entry in enumerate(written.nodes):
        here = place.at("nodes").at(index)
        beats_s = entry.heartbeat_s if entry.heartbeat_s is not None else written.heartbeat_s
        lost_s = entry.lost_after_s if entry.lost_after_s is not None else written.lost_after_s
        _check_pair(here, place, beats_s, lost_s)
        if entry.address == own:
            heartbeat_s = beats_s
        elif lost_s is not None:
            lost_after_s[entry.address] = lost_s
    return ContactRules(
        heartbeat_s=heartbeat_s,
        lost_after_s=lost_after_s,
        others_lost_after_s=written.lost_after_s,
        lost_contact=lost_contact,
        announces=True,
    )


def _check_pair(
    place: Place, section: Place, heartbeat_s: float | None, lost_after_s: float | None
) -> None:
    """Check that no node counts as lost before it can have been heard."""
    if heartbeat_s is None or lost_after_s is None or lost_after_s >= LEAST_MISSED * heartbeat_s:
        return
    where = place if place.at("lost_after_s").written is not None else section
    whose = "" if place is section else f" of {place.at('name').written}"
    where.at("lost_after_s").refuse(
        f"{lost_after_s:g} with heartbeat_s {heartbeat_s:g}{whose}",
        allowed=f"{LEAST_MISSED * heartbeat_s:g} or more, twice heartbeat_s",
        hint="any one heartbeat may be lost: three or four times is better",
    )
