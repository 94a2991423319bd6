"""Medium access: when a node may put a frame on the channel.

One file per policy, all with the interface of `zacoustic.core.schedule.access.base.MediumAccess`:

=================  =================================================================================
`delegated`        the modem, or what is behind it, decides
`aloha`            at once, or at the next slot; a back-off after losses
`carriersense`     not while another node is heard; a back-off after that
`tdma`             in the slots of this node, by a common clock; `schedule` has the same file
`polling`          when one node gives this node the turn
=================  =================================================================================

`spec` has the settings; `choose` makes a policy from them, or picks one by the link's capabilities.
`listening` applies to all policies without turns: pauses in which others are heard. `networktime`
is the clock of slots; the controls of policies are in `zacoustic.core.wire.access`.
"""

import random

from zacoustic.core.base.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.aloha import Aloha
from zacoustic.core.schedule.access.base import MediumAccess, Wanted
from zacoustic.core.schedule.access.carriersense import CarrierSense
from zacoustic.core.schedule.access.delegated import Delegated
from zacoustic.core.schedule.access.listening import Listening
from zacoustic.core.schedule.access.polling import polling
from zacoustic.core.schedule.access.spec import (
    AccessSpec,
    AlohaSpec,
    CarrierSenseSpec,
    ClockedSpec,
    DelegatedSpec,
    PollingSpec,
    ScheduledSlot,
    ScheduleSpec,
    TdmaSpec,
)
from zacoustic.core.schedule.access.tdma import Tdma
from zacoustic.errors import ConfigError

__all__ = [
    "Aloha",
    "AlohaSpec",
    "CarrierSense",
    "CarrierSenseSpec",
    "ClockedSpec",
    "Delegated",
    "DelegatedSpec",
    "Listening",
    "MediumAccess",
    "PollingSpec",
    "ScheduleSpec",
    "ScheduledSlot",
    "Tdma",
    "TdmaSpec",
    "Wanted",
    "choose",
]


def choose(
    spec: AccessSpec | None, capabilities: LinkCapabilities, address: int, rng: random.Random
) -> MediumAccess:
    """Make the policy of a link.

    Args:
        spec: The settings of the config; None: delegated where the device controls access, else
            carrier sense where it senses a carrier, else ALOHA.
        capabilities: The link's.
        address: Address of this node.
        rng: For the back-off.

    Raises:
        ConfigError: The choice cannot work on this link; says why.
    """
    if spec is None:
        spec = _natural(capabilities)
    elif capabilities.controls_access and not isinstance(spec, DelegatedSpec):
        raise ConfigError(
            f'access.method: "{spec.__struct_config__.tag}"; this link controls access by itself, '
            'so that a frame does not start when it is handed over; allowed: "delegated"'
        )
    match spec:
        case DelegatedSpec():
            if not capabilities.controls_access:
                raise ConfigError(
                    'access.method: "delegated"; this link does not control access; allowed: '
                    '"aloha", "tdma", "schedule", "polling"'
                    + (', "carrier_sense"' if capabilities.senses_carrier else "")
                )
            return Delegated()
        case AlohaSpec():
            _check_slot(spec, capabilities)
            return Aloha(spec, capabilities, rng)
        case CarrierSenseSpec():
            if not capabilities.senses_carrier:
                raise ConfigError(
                    'access.method: "carrier_sense"; this link does not tell when somebody else is '
                    'heard; allowed: "aloha", "tdma", "schedule", "polling"'
                )
            return CarrierSense(capabilities, rng)
        case TdmaSpec() | ScheduleSpec():
            return Tdma(spec, capabilities, address)
        case PollingSpec():
            return polling(spec, capabilities, address)


def _natural(capabilities: LinkCapabilities) -> AccessSpec:
    if capabilities.controls_access:
        return DelegatedSpec()
    return CarrierSenseSpec() if capabilities.senses_carrier else AlohaSpec()


def _check_slot(spec: AlohaSpec, capabilities: LinkCapabilities) -> None:
    largest_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
    if spec.slot_s is not None and seconds_to_ns(spec.slot_s) < largest_ns:
        raise ConfigError(
            f"access.slot_s: {spec.slot_s:g} s; the largest frame of this link takes "
            f"{ns_to_seconds(largest_ns):.3f} s; allowed: at least that"
        )
