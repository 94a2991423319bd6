"""The channel of a recording, as its frames show it: positions of the nodes, and losses.

Delays are measured by modems, or assumed by the link. Losses are counted between recorded nodes,
without overlapped frames: collisions and half-duplex are simulated, and would count twice.
"""

import math
from typing import Final

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.facts import Facts, Frame
from zacoustic.app.tools.inspect.recordings.report.linkfigures import numbers_of
from zacoustic.app.tools.inspect.recordings.report.spread import spread_of
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.profiles import PROFILES, ModemProfile
from zacoustic.channel.scenario import LinkSpec, NodeSpec, Scenario
from zacoustic.core.base.linktypes import BROADCAST, LinkCapabilities
from zacoustic.testing.virtual import Modem

_SOUND_M_S: Final = 1500.0
_DEPTH_M: Final = 10.0
_MOST_LOSS: Final = 0.99
# Difference of two computers' clocks, and time from a sound to its report.
_CLOCKS_NS: Final = 5_000_000_000
_USUAL_S: Final = 1.0

Pair = tuple[int, int]


class MeasuredChannel(msgspec.Struct, frozen=True, kw_only=True):
    """The result of the measurement."""

    scenario: Scenario
    """Nodes, delays and losses."""
    modem: Modem
    """Behaviour of the modems."""
    losses: dict[str, float]
    """Share of frames lost without an overlap, by `SOURCE to NODE`."""
    notes: list[str]
    """Assumptions, a line each."""


def measure_channel(facts: Facts, *, seed: int) -> MeasuredChannel:
    """Measure the channel of a recording."""
    notes: list[str] = []
    nodes = sorted({*facts.tables, *facts.sources} - {0})
    delays = _delays(facts, nodes, notes)
    losses = _losses(facts, delays)
    capabilities = next(iter(facts.capabilities.values()), None)
    profile = _profile(capabilities, notes)
    if len(facts.tables) < 2:
        notes.append("the losses are not known, since one end alone is recorded: none are assumed")
    scenario = Scenario(
        nodes=tuple(
            NodeSpec(address=node, position=place)
            for node, place in zip(nodes, _places(nodes, delays), strict=True)
        ),
        seed=seed,
        sound_speed_m_s=_SOUND_M_S,
        profile=profile.name,
        channel="none",
        links=tuple(
            LinkSpec(source=source, target=node, loss=LossSpec(frame=share))
            for (source, node), share in sorted(losses.items())
        ),
    )
    return MeasuredChannel(
        scenario=scenario,
        modem=_modem(capabilities, profile),
        losses={f"{source} to {node}": share for (source, node), share in sorted(losses.items())},
        notes=notes,
    )


def with_loss(scenario: Scenario, *, add: float = 0.0, instead: float | None = None) -> Scenario:
    """Return a scenario with more loss.

    Args:
        scenario: The channel.
        add: Added share of lost frames, in every direction.
        instead: The share, in place of the measured one.
    """

    def changed(loss: LossSpec) -> LossSpec:
        share = loss.frame if instead is None else instead
        return LossSpec(frame=min(_MOST_LOSS, max(0.0, share + add)))

    links = tuple(
        msgspec.structs.replace(link, loss=None if link.loss is None else changed(link.loss))
        for link in scenario.links
    )
    return msgspec.structs.replace(scenario, loss=changed(scenario.loss), links=links)


def _delays(facts: Facts, nodes: list[int], notes: list[str]) -> dict[Pair, float]:
    """Return the propagation delay of each pair, equal in both directions, s."""
    measured: dict[Pair, list[float]] = {}
    for _, (one, other), delay_s in numbers_of(facts, "propagation_s"):
        measured.setdefault((min(one, other), max(one, other)), []).append(delay_s)
    usual_s = max((each.propagation_s for each in facts.capabilities.values()), default=_USUAL_S)
    found: dict[Pair, float] = {}
    for index, one in enumerate(nodes):
        for other in nodes[index + 1 :]:
            spread = spread_of(measured.get((one, other), []))
            if spread is None:
                notes.append(
                    f"nobody has measured how far {one} and {other} are apart: {usual_s:g} s"
                )
            found[one, other] = found[other, one] = usual_s if spread is None else spread.p50
    return found


def _places(nodes: list[int], delays: dict[Pair, float]) -> list[tuple[float, float, float]]:
    """Return positions with these distances: exact for three nodes, approximate for more."""
    places: list[tuple[float, float, float]] = []
    for index, node in enumerate(nodes):
        distances = [delays[node, other] * _SOUND_M_S for other in nodes[:index]]
        if index == 0:
            x, y = 0.0, 0.0
        elif index == 1:
            x, y = distances[0], 0.0
        else:
            base = places[1][0] or 1.0
            x = (distances[0] ** 2 - distances[1] ** 2 + base**2) / (2 * base)
            y = math.sqrt(max(0.0, distances[0] ** 2 - x**2))
        places.append((x, y, _DEPTH_M))
    return places


def _losses(facts: Facts, delays: dict[Pair, float]) -> dict[Pair, float]:
    sounds = [
        (frame.at_ns, frame.at_ns + round(frame.airtime_s * 1e9), frame)
        for frame in facts.frames
        if frame.is_sent
    ]
    sounds.sort(key=lambda each: each[0])
    heard: dict[tuple[int, int, bytes], list[int]] = {}
    for frame in facts.frames:
        if not frame.is_sent:
            heard.setdefault((frame.source, frame.node, frame.content), []).append(frame.at_ns)
    found: dict[Pair, float] = {}
    for node in facts.tables:
        arrivals = [
            each for each in _arrivals(sounds, node, delays) if facts.is_recorded(node, each[1])
        ]
        for source in facts.tables:
            if source != node and (source, node) in delays:
                sent, lost = _count(arrivals, source, node, heard)
                if sent:
                    found[source, node] = min(_MOST_LOSS, lost / sent)
    return found


Sound = tuple[int, int, Frame]


def _arrivals(sounds: list[Sound], node: int, delays: dict[Pair, float]) -> list[Sound]:
    """Return the beginning of each frame at a node, including its own, in order."""
    found = []
    for begun, ended, frame in sounds:
        later = round(delays.get((frame.node, node), 0.0) * 1e9)
        found.append((begun + later, ended + later, frame))
    return sorted(found, key=lambda each: each[0])


def _count(
    arrivals: list[Sound], source: int, node: int, heard: dict[tuple[int, int, bytes], list[int]]
) -> tuple[int, int]:
    """Count the frames without an overlap, and the lost ones among them."""
    sent = lost = 0
    ended_before = 0
    for index, (begun, ended, frame) in enumerate(arrivals):
        begins_next = arrivals[index + 1][0] if index + 1 < len(arrivals) else ended
        is_alone = ended_before <= begun and begins_next >= ended
        ended_before = max(ended_before, ended)
        if frame.node != source or frame.destination not in (node, BROADCAST):
            continue
        came = _take(heard.get((source, node, frame.content), []), ended)
        if is_alone:
            sent += 1
            lost += not came
    return sent, lost


def _take(times: list[int], expected: int) -> bool:
    """Take the arrival of a frame, if there is one."""
    near = [each for each in times if abs(each - expected) < _CLOCKS_NS]
    if not near:
        return False
    times.remove(min(near, key=lambda each: abs(each - expected)))
    return True


def _profile(capabilities: LinkCapabilities | None, notes: list[str]) -> ModemProfile:
    """Return the profile with the most similar airtimes."""
    if capabilities is None:
        notes.append("what the modem can do is not in the recording: an S2C 18/34 is assumed")
        return PROFILES["evologics_s2c_18_34"]

    def distance(profile: ModemProfile) -> float:
        size = min(profile.mtu_bytes, capabilities.mtu_bytes)
        lasts_s = capabilities.airtime_ns(size) / 1e9
        mtu = abs(math.log(profile.mtu_bytes / capabilities.mtu_bytes)) / 10
        return abs(math.log(max(profile.airtime_s(size), 1e-9) / max(lasts_s, 1e-9))) + mtu

    best = min(PROFILES.values(), key=distance)
    if distance(best) > 0.05:
        notes.append(f"no profile is this modem; the nearest, {best.name}, stands for it")
    return best


def _modem(capabilities: LinkCapabilities | None, profile: ModemProfile) -> Modem:
    if capabilities is None:
        return Modem()
    return Modem(
        addressed=capabilities.addressed,
        checked=capabilities.checked,
        framed=capabilities.framed,
        senses_carrier=capabilities.senses_carrier,
        acknowledges=capabilities.acknowledges,
        mtu_bytes=capabilities.mtu_bytes,
    )
