"""Medium access: when a node may put a frame on the channel.

One file per policy, all with the interface of `zacoustic.core.schedule.access.base.MediumAccess`:

=================  =================================================================================
`auto`             by the schedule while the clock is good, else as the link can
`delegated`        the modem, or what is behind it, decides
`aloha`            at once, or at the next slot; a back-off after losses
`carriersense`     not while another node is heard; a back-off after that
`tdma`             in the slots of this node, by a common clock; `schedule` has the same file
`polling`          when one node gives this node the turn
=================  =================================================================================

`spec` has the settings; `choose` makes a policy from them, or picks one by the link's capabilities,
and `choice` says which and why. `slotwatch` tells from arrivals whether a schedule holds.
`listening` applies to all policies without turns: pauses in which others are heard. `networktime`
is the clock of slots; the controls of policies are in `zacoustic.core.wire.access`.
"""

import random
from collections.abc import Callable

from zacoustic.core.base.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.aloha import Aloha
from zacoustic.core.schedule.access.auto import Auto
from zacoustic.core.schedule.access.base import (
    AccessState,
    MediumAccess,
    SlotFault,
    Trouble,
    Wanted,
)
from zacoustic.core.schedule.access.carriersense import CarrierSense
from zacoustic.core.schedule.access.delegated import Delegated
from zacoustic.core.schedule.access.fairshare import never
from zacoustic.core.schedule.access.listening import Listening
from zacoustic.core.schedule.access.polling import polling
from zacoustic.core.schedule.access.spec import (
    AccessSpec,
    AlohaSpec,
    AutoSpec,
    CarrierSenseSpec,
    ClockedSpec,
    DelegatedSpec,
    PollingSpec,
    ScheduledSlot,
    ScheduleSpec,
    TdmaSpec,
    slots_of,
)
from zacoustic.core.schedule.access.tdma import Tdma
from zacoustic.errors import ConfigError

__all__ = [
    "AccessState",
    "Aloha",
    "AlohaSpec",
    "Auto",
    "AutoSpec",
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
    "SlotFault",
    "Tdma",
    "TdmaSpec",
    "Trouble",
    "Wanted",
    "choice",
    "choose",
    "slots_of",
]


def choose(
    spec: AccessSpec | None,
    capabilities: LinkCapabilities,
    address: int,
    rng: random.Random,
    is_crowd: Callable[[], bool] = never,
) -> MediumAccess:
    """Make the policy of a link.

    Args:
        spec: The settings of the config; None: "auto" without a schedule.
        capabilities: The link's.
        address: Address of this node.
        rng: For the back-off.
        is_crowd: Returns whether at least two other nodes are known.

    Raises:
        ConfigError: The choice cannot work on this link; says why.
    """
    if spec is None or isinstance(spec, AutoSpec):
        schedule = _schedule_for(spec, capabilities, address)
        spec = _natural(capabilities)
        if isinstance(schedule, ScheduleSpec):
            otherwise = choose(spec, capabilities, address, rng, is_crowd)
            method = str(spec.__struct_config__.tag)
            return Auto(Tdma(schedule, capabilities, address), otherwise, method)
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
            return CarrierSense(capabilities, rng, is_crowd)
        case TdmaSpec() | ScheduleSpec():
            return Tdma(spec, capabilities, address)
        case PollingSpec():
            return polling(spec, capabilities, address)


def choice(spec: AutoSpec | None, capabilities: LinkCapabilities, address: int) -> tuple[str, str]:
    """Return what "auto" chooses on a link, and why.

    Args:
        spec: The settings of the config; None: there are none.
        capabilities: The link's.
        address: Address of this node.
    """
    natural = _natural(capabilities)
    method = str(natural.__struct_config__.tag)
    schedule = _schedule_for(spec, capabilities, address)
    if isinstance(schedule, ScheduleSpec):
        clock = "UTC" if schedule.clock is None else f"the clock of node {schedule.clock}"
        return "schedule", (
            f"the file has one, with a cycle of {schedule.cycle_s:.1f} s, and this node has a slot "
            f"in it; while {clock} is not known to {schedule.clock_error_s:g} s, it is {method}"
        )
    reasons = {
        "delegated": "the link controls access itself",
        "carrier_sense": "the modem tells when it hears another one",
        "aloha": "the modem does not tell when it hears another one",
    }
    return method, f"{schedule}, and {reasons[method]}"


def _schedule_for(
    spec: AutoSpec | None, capabilities: LinkCapabilities, address: int
) -> ScheduleSpec | str:
    """Return the schedule that "auto" uses on a link, or why it uses none."""
    schedule = spec.schedule if spec is not None else None
    if schedule is None:
        return "the file has no schedule"
    if capabilities.controls_access:
        return "no schedule works on this link"
    if not schedule.has_slot(address):
        return f"the schedule has no slot for node {address}"
    try:
        Tdma(schedule, capabilities, address)
    except ConfigError as error:
        return f"the schedule does not fit: {error.args[0]}"
    return schedule


def _natural(capabilities: LinkCapabilities) -> DelegatedSpec | CarrierSenseSpec | AlohaSpec:
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
