"""Whether a walk fits: transmitted, in time, and within the limit of the medium access."""

import math
from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.design.plan.fleet import Fleet, Refused
from zacoustic.app.tools.design.plan.offers import Offer
from zacoustic.app.tools.design.plan.walk import Found, Walk
from zacoustic.channel.profiles import profile_named
from zacoustic.core.base.qos import Reliability
from zacoustic.core.schedule.access.spec import AlohaSpec
from zacoustic.core.streams.specs import ServiceSpec, in_parts
from zacoustic.core.streams.table import Stream
from zacoustic.errors import LocalError, PayloadTooLargeError

LEAST_WENT: Final = 0.95
"""Least share of the samples that must be transmitted."""
ALOHA_LIMIT: Final = 0.18
"""Capacity of unslotted ALOHA: 1/(2e) of the time."""
MOST_ARRIVALS: Final = 8_000
"""Most arrivals of a plan without a given length: some three seconds."""
MOST_TRIED_ARRIVALS: Final = 2_000
"""The same for each trial."""
_SEVERAL: Final = 3.0
"""A sample with more airtime than so many of the largest frames takes several."""
_HALF, _WORST = 0.5, 0.99
_ENOUGH, _ENOUGH_SURE = 20, 5
"""So many transmissions, and of what is repeated so many, of which none arrives: none ever does."""


class StreamFound(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a walk for one stream."""

    stream: Stream
    """The stream."""
    wanted: float
    """Samples or calls that should be transmitted."""
    went: float
    """Share of them that were, 0…1."""
    airtime_s: float
    """Their airtime, s."""
    expected_s: float | None
    """Median latency, s."""
    worst_s: float | None
    """99th percentile of the latency, s."""
    bound_s: float | None
    """Promised period or lifespan, s."""
    arrived: float = 1.0
    """Least share of the transmitted samples that a receiver has got, 0…1; 1 for what may be lost
    on its way."""
    unreached: tuple[int, ...] = ()
    """Nodes that should receive it, and have received nothing of much of it."""
    every_s: float | None = None
    """Period of a topic whose samples take several frames, of one after the other, s; None: of
    another one."""
    open_s: float = 0.0
    """For how long the oldest sample of such a topic that has not arrived was under way at the
    end, s; 0: all have."""
    refused: float = 0.0
    """Share of its samples that publishing refuses, 0…1."""
    reason: str = ""
    """Reason of the refusal."""

    @property
    def demand_s(self) -> float:
        """Airtime if all of it were transmitted, s."""
        return self.airtime_s / self.went if self.went else 0.0

    @property
    def is_open(self) -> bool:
        """Its first sample takes several frames, and was still under way at the end."""
        return self.every_s is not None and self.open_s > 0 and self.expected_s is None

    @property
    def misfit(self) -> str:
        """Why it does not fit; empty: it does."""
        if self.refused > 1 - LEAST_WENT:
            return f"{self.refused:.0%} of its samples are refused: {self.reason}"
        if self.unreached:
            nodes = ", ".join(map(str, self.unreached))
            return f"nothing of it arrives at node {nodes}"
        if self.arrived < LEAST_WENT:
            return (
                f"{1 - self.arrived:.0%} of it never arrives although it is repeated: pushed out, "
                "or too old, before it was acknowledged"
            )
        if self.every_s is not None:
            takes_s = max(self.expected_s or 0.0, self.open_s)
            if takes_s > self.every_s:
                return f"takes {takes_s:.0f} s, and the next one comes after {self.every_s:g} s"
        if self.went < LEAST_WENT:
            return f"{1 - self.went:.0%} of it never goes: pushed out, or too old before its turn"
        if self.bound_s is not None and self.worst_s is not None and self.worst_s > self.bound_s:
            return (
                f"takes up to {self.worst_s:.1f} s, and is worth nothing after {self.bound_s:g} s"
            )
        return ""


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """Whether it fits."""

    demand: float
    """Share of the time that all traffic takes if all is transmitted; may be above 1."""
    misfits: tuple[str, ...]
    """What does not fit, the worst first."""
    agreement: float
    """Share of the time that agreement on tables takes; may be above 1."""

    @property
    def fits(self) -> bool:
        """Whether everything fits."""
        return not self.misfits


def walk(
    fleet: Fleet,
    until_s: float,
    seed: int,
    most_arrivals: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Found:
    """Run the engines of a fleet with its traffic for a time.

    Args:
        fleet: The fleet.
        until_s: Time, s.
        seed: Seed of all draws, from 1.
        most_arrivals: Stop some seconds after that many frames have arrived, each counted at each
            node: with many nodes a walk is slow.
        progress: Called with the done share, 0…1.
    """
    started = Walk(
        fleet.scenario, fleet.tables, fleet.rules, fleet.offers, seed, fleet.security, fleet.members
    )
    return started.run(until_s, most_arrivals, progress)


def streams_of(fleet: Fleet, found: Found) -> list[StreamFound]:
    """Return the result of each stream, the largest first."""
    by_id = {offer.stream.stream_id: offer.stream for offer in fleet.offers}
    rows = []
    for stream_id, stream in by_id.items():
        own = [offer for offer in fleet.offers if offer.stream.stream_id == stream_id]
        # Samples within the minimum interval are left out on purpose.
        floor_s = stream.qos.min_interval_s
        allowed = sum(min(1.0, each.every_s / floor_s) if floor_s else 1.0 for each in own)
        wanted = found.said.get(stream_id, 0) * allowed / len(own)
        latencies = sorted(found.latencies_s.get(stream_id, ()))
        went = found.went.get(stream_id, 0)
        refused = found.refused.get(stream_id, 0) / max(1, found.said.get(stream_id, 0))
        refusal = fleet.refused.get(stream_id)
        rows.append(
            StreamFound(
                stream=stream,
                wanted=wanted,
                # The last ones may still wait.
                went=min(1.0, (went + len(own)) / wanted) if wanted else 1.0,
                airtime_s=found.stream_airtime_s.get(stream_id, 0.0),
                expected_s=_share_of(latencies, _HALF),
                worst_s=_share_of(latencies, _WORST),
                bound_s=_bound_s(stream),
                refused=max(refused, refusal.share if refusal else 0.0),
                reason=_reason(stream, found.refusals.get(stream_id), refusal),
                unreached=_unreached(fleet, stream, own, found),
                arrived=_arrived(fleet, stream, own, found),
                every_s=_period_s(fleet, stream, own, found),
                open_s=_open_s(fleet, stream, own, found),
            )
        )
    return sorted(rows, key=lambda row: -row.demand_s)


def verdict_of(fleet: Fleet, streams: list[StreamFound], found: Found) -> Verdict:
    """Evaluate a walk."""
    until_s = found.walked_s
    others_s = found.stream_airtime_s.get(0, 0.0)
    demand = (sum(each.demand_s for each in streams) + others_s) / until_s
    misfits = [f"{each.stream.name}: {each.misfit}" for each in streams if each.misfit]
    planned = {each.stream.stream_id for each in streams}
    table = next(iter(fleet.tables.values()))
    misfits += [
        f"{table.by_id(stream_id).name}: {each.share:.0%} of its samples are refused: {each.reason}"
        for stream_id, each in fleet.refused.items()
        if stream_id not in planned
    ]
    uses_aloha = any(isinstance(each.access, AlohaSpec) for each in fleet.rules.values())
    if uses_aloha and demand > ALOHA_LIMIT:
        misfits.append(
            f"all of it is {demand:.0%} of the time; without a schedule (aloha) at most "
            f"{ALOHA_LIMIT:.0%} gets through"
        )
    agreement = found.agreement_s / until_s
    if agreement > 1:
        misfits.insert(0, f"agreement on tables alone takes {agreement:.0%} of the time")
    elif demand > 1 and not misfits:
        misfits.append(f"all of it is {demand:.0%} of the time")
    if agreement <= 1 and misfits and streams and demand:
        first = streams[0]
        misfits.insert(
            0, f"{first.stream.name} alone takes {first.demand_s / until_s:.0%} of the time"
        )
    return Verdict(demand=demand, misfits=tuple(misfits), agreement=agreement)


def _reason(stream: Stream, error: LocalError | None, refusal: Refused | None) -> str:
    """Return why samples are refused: by the engine, or when the recording was read."""
    if error is None:
        return refusal.reason if refusal else ""
    if isinstance(error, PayloadTooLargeError):
        return f"larger than a frame ({in_parts(stream.spec)})"
    return str(error)


def _unreached(fleet: Fleet, stream: Stream, own: Sequence[Offer], found: Found) -> tuple[int, ...]:
    """Return the receivers that got nothing, of so much that loss does not explain it."""
    is_sure = isinstance(stream.spec, ServiceSpec) or (
        stream.qos.reliability is Reliability.RELIABLE
    )
    went = found.went.get(stream.stream_id, 0)
    if went < (_ENOUGH_SURE if is_sure else _ENOUGH):
        return ()
    return tuple(
        sorted(_receivers(fleet, stream, own) - set(found.arrived.get(stream.stream_id, ())))
    )


def _arrived(fleet: Fleet, stream: Stream, own: Sequence[Offer], found: Found) -> float:
    """Return the least share of a reliable topic's samples that a receiver has got, 0…1."""
    went = found.went.get(stream.stream_id, 0)
    if stream.qos.reliability is not Reliability.RELIABLE or not went:
        return 1.0
    by_speaker = went / len({each.node for each in own})
    got = found.arrived.get(stream.stream_id, {})
    shares = [
        # The last ones may still be on their way.
        (got.get(each, 0) + stream.qos.depth * len(own))
        / (went - (by_speaker if each in {offer.node for offer in own} else 0.0) or 1.0)
        for each in _receivers(fleet, stream, own)
    ]
    return min(1.0, *shares, 1.0)


def _period_s(fleet: Fleet, stream: Stream, own: Sequence[Offer], found: Found) -> float | None:
    """Return the shortest period of a topic whose samples take several frames each, s, or None.

    What takes one frame may be on its way for longer than its period: the next one follows it.
    """
    said = found.said.get(stream.stream_id, 0)
    if isinstance(stream.spec, ServiceSpec) or not said:
        return None
    largest_s = max(_largest_s(fleet), 1e-9)
    each_s = found.stream_airtime_s.get(stream.stream_id, 0.0) / said
    return min(each.every_s for each in own) if each_s > _SEVERAL * largest_s else None


def _largest_s(fleet: Fleet) -> float:
    profile = profile_named(fleet.scenario.profile)
    return profile.airtime_s(profile.mtu_bytes)


def _open_s(fleet: Fleet, stream: Stream, own: Sequence[Offer], found: Found) -> float:
    """Return for how long the oldest sample without arrival was under way at the end, s."""
    said_s = found.said_s.get(stream.stream_id, [])
    if stream.qos.reliability is not Reliability.RELIABLE:
        return 0.0
    got = found.arrived.get(stream.stream_id, {})
    arrived = min((got.get(each, 0) for each in _receivers(fleet, stream, own)), default=0)
    return found.walked_s - said_s[arrived] if arrived < len(said_s) else 0.0


def _receivers(fleet: Fleet, stream: Stream, own: Sequence[Offer]) -> set[int]:
    """Return the nodes that should receive the samples of a topic, or the answers of a service."""
    speakers = {each.node for each in own}
    if isinstance(stream.spec, ServiceSpec):
        return speakers
    return {each for each in fleet.tables if stream.may_subscribe(each) and speakers - {each}}


def _share_of(latencies_s: list[float], share: float) -> float | None:
    """Return a quantile of sorted latencies, s; None: there are none."""
    return latencies_s[math.ceil(share * len(latencies_s)) - 1] if latencies_s else None


def _bound_s(stream: Stream) -> float | None:
    bounds = [each for each in (stream.qos.lifespan_s, stream.qos.deadline_s) if each is not None]
    timeout_s = getattr(stream.spec, "timeout_s", None)
    return min([*bounds, timeout_s] if timeout_s is not None else bounds, default=None)
