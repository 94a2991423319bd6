"""What the fair share of a node costs, in a line of `check` and `plan`."""

from collections.abc import Iterator
from typing import Final

from zacoustic.channel.profiles import ModemProfile
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.profiles.rules import LinkRules
from zacoustic.core.schedule.access import PollingSpec, slots_of
from zacoustic.core.schedule.access.fairshare import fair_share

_LEAST_NODES: Final = 3
_PHOTO_BYTES: Final = 20_000


def capabilities_like(profile: ModemProfile, *, controls_access: bool = False) -> LinkCapabilities:
    """Return the capabilities of a link with such a modem, which tells when it hears another one.

    Args:
        profile: The modem.
        controls_access: Whether it decides when it may transmit.
    """
    return LinkCapabilities(
        mtu_bytes=profile.mtu_bytes,
        bit_rate_bps=profile.bit_rate_bps,
        preamble_s=profile.preamble_s,
        gap_s=profile.gap_s,
        controls_access=controls_access,
        senses_carrier=True,
    )


def share_notes(capabilities: LinkCapabilities, own: LinkRules, nodes: int) -> Iterator[str]:
    """Say what a node of a fleet takes at most for what is not urgent.

    Args:
        capabilities: The link's.
        own: The rules of the node for it.
        nodes: How many nodes the fleet has, this one included.
    """
    has_turns = slots_of(own.access) is not None or isinstance(own.access, PollingSpec)
    if nodes < _LEAST_NODES or not capabilities.half_duplex or has_turns:
        return
    if own.max_airtime is not None:
        return  # the user has decided
    share = fair_share(capabilities, None)
    photo_s = 8 * _PHOTO_BYTES / capabilities.bit_rate_bps
    yield (
        f"fair share: among {nodes} nodes each takes at most {share:.0%} of the time for what is "
        f"not urgent, so that emergencies of others arrive; 20 kB need {photo_s / share:.0f} s "
        f"instead of {photo_s:.0f} s (max_airtime: 1 lifts it)"
    )
