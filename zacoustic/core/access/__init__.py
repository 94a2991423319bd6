"""Medium access: when a node may put a frame on the water.

One file per policy, all with the interface of `zacoustic.core.access.base.MediumAccess`. `choose`
picks by what the link says of itself; further policies (ALOHA, TDMA, polling) come with their own
configuration.
"""

import random

from zacoustic.core.access.base import MediumAccess
from zacoustic.core.access.defer import Defer
from zacoustic.core.access.delegated import Delegated
from zacoustic.core.linktypes import LinkCapabilities

__all__ = ["Defer", "Delegated", "MediumAccess", "choose"]


def choose(capabilities: LinkCapabilities, rng: random.Random) -> MediumAccess:
    """Return the policy for a link: delegated where the device controls access, else defer."""
    if capabilities.controls_access:
        return Delegated()
    return Defer(capabilities, rng)
