"""Single changes that make the traffic fit: each is simulated, and named if it does.

It tries, in order of inconvenience: another codec for the largest, several samples in a frame, a
longer interval of the largest, all of that together, longer intervals of everything.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Final

import msgspec

from zacoustic.app.tools.design.plan.fleet import Fleet
from zacoustic.app.tools.design.plan.tables import Respecify, respecified
from zacoustic.app.tools.design.plan.verdict import (
    MOST_ARRIVALS,
    MOST_TRIED_ARRIVALS,
    StreamFound,
    Verdict,
    streams_of,
    verdict_of,
    walk,
)
from zacoustic.app.tools.design.plan.walk import Found
from zacoustic.core.base.qos import Priority, Reliability
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.streams.specs import StreamSpec, TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.errors import ConfigError

_TRIED_PERIODS: Final = 20.0
_LEAST_TRIED_S, _MOST_TRIED_S = 300.0, 3600.0
"""Length of a trial, s: a number of periods of the rarest traffic, within these limits."""
_ENOUGH_ARRIVALS, _MOST_ARRIVALS = 6_000, 16_000
"""Most arriving frames in all trials, once a change fits, and before that: some seconds."""
_SLOWER: Final = (1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0)
_MOST_STREAMS: Final = 2
_LEAST_SHARE: Final = 0.1
"""A stream with a smaller share of all airtime is not changed alone."""
_MOST_CHANGES: Final = 4
_LINGER_S: Final = 10.0


class Change(msgspec.Struct, frozen=True, kw_only=True):
    """A change that makes the traffic fit."""

    what: str
    """Description of the change."""
    demand: float
    """Share of the time that all traffic then takes."""


def changes_that_fit(
    fleet: Fleet,
    streams: Sequence[StreamFound],
    verdict: Verdict,
    seed: int,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[Change, ...]:
    """Try changes.

    Args:
        fleet: The fleet that does not fit.
        streams: Its streams, the largest first.
        verdict: What does not fit.
        seed: Seed of all draws, from 1.
        progress: Called with the done share, 0…1.
    """
    found: list[Change] = []
    arrivals = 0
    # Where agreement alone is too much, no other change helps.
    ladders = [_tagged(fleet)] if verdict.agreement > 1 else _ladders(fleet, streams)
    for attempts in ladders:
        for what, changed in attempts:
            most = _ENOUGH_ARRIVALS if found else _MOST_ARRIVALS
            progress(min(1.0, arrivals / most))
            if arrivals >= most:
                return tuple(found)
            result = _try(changed, seed, whole=any(row.every_s is not None for row in streams))
            arrivals += result.arrivals
            rows = streams_of(changed, result)
            then = verdict_of(changed, rows, result)
            if then.fits and not any(row.is_open for row in rows):
                found.append(Change(what=what, demand=then.demand))
                break
        if len(found) >= _MOST_CHANGES:
            break
    return tuple(found)


def _try(fleet: Fleet, seed: int, *, whole: bool) -> Found:
    """Walk for a trial; `whole`: as long as the plan, since a sample may take an hour."""
    rarest_s = max(offer.every_s for offer in fleet.offers)
    tried_s = min(max(_LEAST_TRIED_S, _TRIED_PERIODS * rarest_s), _MOST_TRIED_S)
    if whole:
        return walk(fleet, 2 * rarest_s, seed, MOST_ARRIVALS)
    return walk(fleet, tried_s, seed, MOST_TRIED_ARRIVALS)


def _ladders(fleet: Fleet, streams: Sequence[StreamFound]) -> Iterator[Iterator[tuple[str, Fleet]]]:
    """Yield series of changes; each is only tried if those before it are insufficient."""
    least_s = _LEAST_SHARE * sum(each.demand_s for each in streams)
    heavy = [each.stream for each in streams[:_MOST_STREAMS] if each.demand_s >= least_s]
    yield _tagged(fleet)
    for each in streams:
        if each.refused and isinstance(each.stream.spec, TopicSpec):
            yield _in_parts(fleet, each.stream)
    for stream in heavy:
        yield _recoded(fleet, stream)
    yield _lingering(fleet)
    for stream in heavy:
        yield _slower(fleet, (stream.stream_id,))
    everything = tuple(each.stream.stream_id for each in streams)
    if len(everything) > 1:
        yield _slower(fleet, everything)


def _recoded(fleet: Fleet, stream: Stream) -> Iterator[tuple[str, Fleet]]:
    for codec in ("packed", "dense"):
        if stream.type is None or stream.spec.codec in (codec, "dense"):
            continue
        try:
            changed = _changed(fleet, {stream.stream_id: partial(_replace, codec=codec)})
        except ConfigError:  # a reliable topic cannot be dense
            continue
        yield f'{stream.name}: codec: "{codec}"', changed


def _tagged(fleet: Fleet) -> Iterator[tuple[str, Fleet]]:
    """Replace confirmations by a TAG in each frame."""
    if all(each.agreement is AgreementMethod.CONFIRM for each in fleet.rules.values()):
        rules = {
            address: msgspec.structs.replace(each, agreement=AgreementMethod.TAG)
            for address, each in fleet.rules.items()
        }
        yield f'agreement: "{AgreementMethod.TAG.value}"', _with(fleet, rules=rules)


def _lingering(fleet: Fleet) -> Iterator[tuple[str, Fleet]]:
    """Let samples that are not urgent wait for others."""

    def linger(spec: StreamSpec) -> StreamSpec:
        depth = max(spec.qos.depth, 8)
        return _replace(
            spec, qos=msgspec.structs.replace(spec.qos, linger_s=_LINGER_S, depth=depth)
        )

    topics = {
        offer.stream.stream_id: offer.stream
        for offer in fleet.offers
        if isinstance(offer.stream.spec, TopicSpec)
        and offer.stream.qos.priority is not Priority.REAL_TIME
        and offer.stream.qos.linger_s < _LINGER_S
    }
    if topics:
        names = ", ".join(each.name for each in topics.values())
        changed = _changed(fleet, dict.fromkeys(topics, linger))
        yield f"{names}: linger_s: {_LINGER_S:g}, with depth: 8", changed


def _slower(fleet: Fleet, stream_ids: Sequence[int]) -> Iterator[tuple[str, Fleet]]:
    """Increase the intervals of streams; tries the proposed values, with three digits."""
    for factor in _SLOWER:
        told: dict[int, str] = {}
        offers = []
        for offer in fleet.offers:
            stream = offer.stream
            if stream.stream_id in stream_ids:
                every_s = float(f"{offer.every_s * factor:.3g}")
                key = "every_s" if offer.is_call else "min_interval_s"
                told.setdefault(stream.stream_id, f"{stream.name}: {key}: {every_s:g}")
                offer = offer.altered(stream, every_s)
            offers.append(offer)
        yield "; ".join(told.values()), _with(fleet, offers=offers)


def _in_parts(fleet: Fleet, stream: Stream) -> Iterator[tuple[str, Fleet]]:
    """Let samples larger than a frame cross in parts."""
    reliable = msgspec.structs.replace(stream.qos, reliability=Reliability.RELIABLE)
    with contextlib.suppress(ConfigError):  # a dense topic cannot be reliable
        changed = _changed(fleet, {stream.stream_id: partial(_replace, qos=reliable)})
        yield f'{stream.name}: reliability: "reliable"', changed


def _changed(fleet: Fleet, changes: Mapping[int, Respecify]) -> Fleet:
    """Return the fleet with other streams.

    Raises:
        ConfigError: A stream cannot have these settings.
    """
    tables = {address: respecified(table, changes) for address, table in fleet.tables.items()}
    any_table = next(iter(tables.values()))
    offers = [
        offer.altered(any_table.by_id(offer.stream.stream_id), offer.every_s)
        for offer in fleet.offers
    ]
    return _with(fleet, offers=offers, tables=tables)


def _replace(spec: StreamSpec, **fields: object) -> StreamSpec:
    return msgspec.structs.replace(spec, **fields)


def _with(fleet: Fleet, **fields: object) -> Fleet:
    return msgspec.structs.replace(fleet, **fields)
