"""The result of a plan: airtime, latency and energy of the traffic, and whether it fits."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.app.tools.design.plan.advice import Change, changes_that_fit
from zacoustic.app.tools.design.plan.agreement import AgreementPlan, agreement_of
from zacoustic.app.tools.design.plan.fleet import AssumedChannel, Fleet, fleet_of
from zacoustic.app.tools.design.plan.sampling import note_on
from zacoustic.app.tools.design.plan.slots import SchedulePlan, schedule_of
from zacoustic.app.tools.design.plan.verdict import (
    MOST_ARRIVALS,
    StreamFound,
    streams_of,
    verdict_of,
    walk,
)
from zacoustic.app.tools.design.plan.walk import Found
from zacoustic.app.tools.design.schedule import ScheduleOptions
from zacoustic.app.tools.design.sharenote import capabilities_like, share_notes
from zacoustic.app.tools.design.sim.fleetrun import links_of
from zacoustic.channel.profiles import ModemProfile, profile_named
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.errors import ConfigError

DEFAULT_HOURS: Final = 4.0
"""Default modelled time, h."""
_S_PER_H: Final = 3600.0
_H_PER_DAY: Final = 24.0
_WALKED, _COMPARED = 0.5, 0.65
"""Share of the work that is done after the simulation, and after the comparison of agreements."""
_WATT_DB: Final = 170.8
"""Source level of one acoustic watt, dB re 1 µPa at 1 m (Urick)."""
_EFFICIENCY: Final = 0.5
"""Efficiency of amplifier and transducer together, assumed if the modem's power is not given."""


class StreamPlan(msgspec.Struct, frozen=True, kw_only=True):
    """The plan of one stream."""

    stream_id: int
    """Its id."""
    name: str
    """Its name."""
    kind: str
    """`topic` or `service`."""
    per_h: float
    """Samples or calls per hour, of all nodes together."""
    airtime_s_per_h: float
    """Airtime per hour, including repetitions, acknowledgements and answers, s."""
    utilisation: float
    """That airtime as a share of the time."""
    share: float
    """That airtime as a share of all airtime, 0…1."""
    went: float
    """Share of its samples that were transmitted, 0…1; without those that `min_interval_s` leaves
    out."""
    refused: float
    """Share of its samples that publishing refuses, 0…1: by their type or for lack of room."""
    expected_s: float | None
    """Median latency, for calls to the answer, s; None: nothing arrived."""
    worst_s: float | None
    """99th percentile of the latency, s."""
    bound_s: float | None
    """Lifespan, deadline or timeout, the shortest of them, s; None: there is none."""
    misfit: str
    """Why it does not fit; empty: it fits."""


class NodePlan(msgspec.Struct, frozen=True, kw_only=True):
    """The plan of one node."""

    address: int
    """Its address."""
    utilisation: float
    """Share of the time in which it transmits."""
    energy_wh_per_day: float
    """Energy of transmitting, Wh per day."""
    relayed: float = 0.0
    """The share of the time, of `utilisation`, that it transmits for routes, bonds and floods:
    frames of other nodes, and what these add to its own."""


class LinkPlan(msgspec.Struct, frozen=True, kw_only=True):
    """The plan of one of several links."""

    name: str
    """Its name."""
    profile: str
    """Its modem."""
    utilisation: float
    """Share of the time with a frame on it, summed over all nodes."""
    paid_per_day: float | None = None
    """What a day of all nodes costs there, in the currency of its tariff; None: it has none."""


class PlanReport(msgspec.Struct, frozen=True, kw_only=True):
    """The plan."""

    file: str
    """The planned file."""
    profile: str
    """Modem."""
    hours: float
    """Simulated time, h."""
    frames_per_h: float
    """Frames of all nodes per hour."""
    utilisation: float
    """Share of the time with sound, summed over all nodes."""
    confidence: float
    """How far `utilisation` may be off because the simulated time is short: by more than this in
    one of 20 simulations."""
    demand: float
    """The same if everything were transmitted."""
    fits: bool
    """Whether everything fits."""
    transmit_w: float
    """Transmit power for the energy, W."""
    streams: tuple[StreamPlan, ...]
    """The streams, the largest first."""
    nodes: tuple[NodePlan, ...]
    """The nodes by address."""
    misfits: tuple[str, ...]
    """What does not fit, in words."""
    changes: tuple[Change, ...]
    """Changes, any one of which makes it fit."""
    agreement: AgreementPlan | None
    """Cost of agreement on tables with each policy; None: there is one node."""
    notes: tuple[str, ...]
    """Remarks on the plan."""
    links: tuple[LinkPlan, ...] = ()
    """Each of several links, or one that costs money; empty: there is one for nothing."""
    schedule: SchedulePlan | None = None
    """The schedule that was asked for."""


def plan(
    path: str | Path,
    *,
    channel: AssumedChannel | None = None,
    recordings: Sequence[str] = (),
    hours: float | None = None,
    transmit_w: float | None = None,
    seed: int = 1,
    schedule: ScheduleOptions | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> PlanReport:
    """Plan a file.

    Args:
        path: A scenario with traffic, or a config.
        channel: Assumptions that a config lacks.
        recordings: Recordings to take sizes and rates from instead.
        hours: Simulated time, h, above 0; None: `DEFAULT_HOURS`, or less if the number of frames
            makes that slow.
        transmit_w: Power of the modem while it transmits, W; None: from its source level.
        seed: Seed of all draws, from 1.
        schedule: Settings of the schedule to make; None: make none.
        progress: Called with the done share, 0…1.

    Raises:
        ConfigError: A file is wrong, or no rates are known.
    """
    fleet = fleet_of(Path(path), recordings, channel or AssumedChannel())
    if any(table.wire is not WireProfile.NATIVE for table in fleet.tables.values()):
        raise ConfigError(f'{path}: wire: "rmw_desert"; allowed: "native", which is what plans are')
    most_arrivals = MOST_ARRIVALS if hours is None else None
    found = walk(
        fleet, (hours or DEFAULT_HOURS) * _S_PER_H, seed, most_arrivals,
        lambda share: progress(_WALKED * share),
    )  # fmt: skip
    until_s = found.walked_s
    hours = until_s / _S_PER_H
    streams = streams_of(fleet, found)
    verdict = verdict_of(fleet, streams, found)
    profile = profile_named(fleet.scenario.profile)
    power_w = transmit_power_w(profile) if transmit_w is None else transmit_w
    airtime_s = sum(found.airtime_s.values())
    agreement = agreement_of(fleet, found, seed)
    progress(_COMPARED)
    changes: tuple[Change, ...] = ()
    if not verdict.fits:
        changes = changes_that_fit(
            fleet, streams, verdict, seed,
            lambda share: progress(_COMPARED + (1 - _COMPARED) * share),
        )  # fmt: skip
    return PlanReport(
        file=str(path),
        profile=profile.name,
        hours=hours,
        frames_per_h=found.frames / hours,
        utilisation=airtime_s / until_s,
        confidence=found.confidence_s / until_s,
        demand=verdict.demand,
        fits=verdict.fits,
        transmit_w=power_w,
        streams=tuple(_stream_plan(each, airtime_s, hours) for each in streams),
        nodes=tuple(_node_plan(each, found, until_s, power_w) for each in fleet.nodes),
        links=_link_plans(fleet, found),
        misfits=verdict.misfits,
        agreement=agreement,
        changes=changes,
        schedule=None
        if schedule is None
        else schedule_of(fleet, found.airtime_s, until_s, schedule),
        notes=(
            *note_on(fleet.members),
            *fleet.notes,
            *_left_out(fleet),
            *_share_notes(fleet),
            *_open_notes(streams),
        ),
    )


def _open_notes(streams: Sequence[StreamFound]) -> Iterator[str]:
    """Name what the simulated time was too short for."""
    for row in streams:
        if row.is_open and not row.misfit:
            yield (
                f"{row.stream.name}: its first sample was still under way after "
                f"{row.open_s:.0f} s; --hours simulates longer"
            )


def _share_notes(fleet: Fleet) -> Iterator[str]:
    """Say what each node leaves free for the others, if the first one does."""
    own = next(iter(fleet.rules.values()), TransmitRules()).of_links[0]
    capabilities = capabilities_like(profile_named(fleet.scenario.profile))
    yield from share_notes(capabilities, own, len(fleet.nodes))


def transmit_power_w(profile: ModemProfile) -> float:
    """Return the power of a modem while it transmits, W, from its source level.

    Source:
        R. J. Urick, Principles of Underwater Sound, 1983: SL = 170.8 + 10 log P, without
        directivity; the efficiency is assumed.
    """
    acoustic_w = 10 ** ((profile.source_level_db - _WATT_DB) / 10)
    return float(acoustic_w / _EFFICIENCY)


def _stream_plan(row: StreamFound, airtime_s: float, hours: float) -> StreamPlan:
    return StreamPlan(
        stream_id=row.stream.stream_id,
        name=row.stream.name,
        kind="service" if isinstance(row.stream.spec, ServiceSpec) else "topic",
        per_h=row.wanted / hours,
        airtime_s_per_h=row.airtime_s / hours,
        utilisation=row.airtime_s / hours / _S_PER_H,
        share=row.airtime_s / airtime_s if airtime_s else 0.0,
        went=row.went,
        refused=row.refused,
        expected_s=row.expected_s,
        worst_s=row.worst_s,
        bound_s=row.bound_s,
        misfit=row.misfit,
    )


def _node_plan(address: int, found: Found, until_s: float, power_w: float) -> NodePlan:
    utilisation = found.airtime_s.get(address, 0.0) / until_s
    return NodePlan(
        address=address,
        utilisation=utilisation,
        energy_wh_per_day=utilisation * power_w * _H_PER_DAY,
        relayed=found.relayed_s.get(address, 0.0) / until_s,
    )


def _link_plans(fleet: Fleet, found: Found) -> tuple[LinkPlan, ...]:
    first, *others = links_of(fleet.rules)
    media = {first: fleet.scenario, **{each: fleet.scenario.medium_of(each) for each in others}}
    tariffs = {
        each.name: each.bonded.tariff for rules in fleet.rules.values() for each in rules.of_links
    }

    def per_day(name: str) -> float | None:
        tariff, paid_bytes = tariffs.get(name), found.link_paid_bytes.get(name, 0)
        if tariff is None:
            return None
        return paid_bytes * tariff.per_byte * _H_PER_DAY * 3600.0 / found.walked_s

    if not others and tariffs.get(first) is None:
        return ()
    return tuple(
        LinkPlan(
            name=name,
            profile=medium.profile,
            utilisation=found.link_airtime_s.get(name, 0.0) / found.walked_s,
            paid_per_day=per_day(name),
        )
        for name, medium in media.items()
    )


def _left_out(fleet: Fleet) -> list[str]:
    if any(rules.quiet for rules in fleet.rules.values()):
        return ["the quiet hours are not in the plan: it is of the hours between"]
    return []
