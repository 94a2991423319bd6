"""Bytes on the air (`bytes_on_air`): what a vehicle's telemetry costs, beside what others need.

Missions are measured with a model that was fitted to the *other* missions. Without FOLDER they are
held out (tests/telemetry/heldout): the coder was made with others. FOLDER may be another one; logs
of real vehicles found there are coded online, with no model at all. `--missions N` makes up those
that the coder was made with. Sizes are of whole dense frames: marker, kind, name of the reference,
check. Every frame that arrives is decoded and compared with what was sent. Below stands the bound:
what no coder could go below (tests/telemetry/bound.py).

    python tests/benchmarks/bench_bytes_on_air.py [FOLDER] [--missions N] [--strict]
"""

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

import msgspec

# Run as a file, as `make bench` does, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.telemetry.baselines import (
    LaplaceCoder,
    cbor_map_bytes,
    dccl_bits,
    dccl_bytes,
    json_bytes,
    rmw_desert_bytes,
)
from tests.telemetry.bound import bound_bytes
from tests.telemetry.crossing import WAYS, Way, cross
from tests.telemetry.exchange import LISTENER, dense_samples, exchange
from tests.telemetry.mission import Mission
from tests.telemetry.recording import Recording, recordings_in
from tests.telemetry.streams import STREAM_IDS, UPLINK, Sample, by_id, is_near
from zacoustic.core.values.dense import (
    DenseCodec,
    DenseSample,
    Listener,
    Model,
    Speaker,
    StreamPrior,
    fit,
)
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.stream.streamcodec import StreamCodec
from zacoustic.core.values.payload import PackedCodec
from zacoustic.core.values.types import TypeSpec

WINDOW_S: Final = 10.0
FRAME_BYTES: Final = 64
ACK_EVERY: Final = 5
LOSSES: Final = (0.0, 0.1, 0.3)
OWN_FRAME: Final = {"ctd": 5.0, "status": 2.9, "cmd": 2.0, "pose": 8.4, "usbl": 5.8}
"""Targets of messages in frames of their own, mean bytes."""
OTHERS: Final[tuple[Callable[[TypeSpec, dict[str, object]], int], ...]] = (
    rmw_desert_bytes,
    cbor_map_bytes,
    json_bytes,
    dccl_bytes,
)
HELD_OUT: Final = Path(__file__).parents[1] / "telemetry" / "heldout"
BOUNDED: Final = ("nav", "ctd", "status", "cmd", "pose", "usbl")
_NAV_PERIOD_S: Final = 5.0
GLIDERS: Final = ("slocum", "seaexplorer")


class Row(msgspec.Struct):
    """One figure."""

    name: str
    value: float
    target: float
    is_least: bool = False
    """More is better."""
    others: Sequence[float] = ()
    """rmw_desert, CBOR map, JSON, DCCL."""

    @property
    def holds(self) -> bool:
        """Whether the target is reached."""
        return self.value >= self.target if self.is_least else self.value <= self.target


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "folder", nargs="?", type=Path, default=HELD_OUT, help="recordings, *.jsonl.gz (held out)"
    )
    parser.add_argument("--missions", type=int, default=0, help="so many of the tests' instead")
    parser.add_argument("--strict", action="store_true", help="exit with 1 when a target is missed")
    arguments = parser.parse_args()
    found = [] if arguments.missions else recordings_in(arguments.folder)
    missions: list[Recording | Mission] = [each for each in found if not each.is_real]
    real = [each for each in found if each.is_real]
    if arguments.missions:
        missions = [Mission(seed) for seed in range(1, arguments.missions + 1)]
    rows: dict[str, list[Row]] = defaultdict(list)
    for place, mission in enumerate(missions):
        others = [each for each in missions if each is not mission]
        started_s = time.process_time()
        model = fit(
            (by_id(each.types), [(t, STREAM_IDS[name], v) for t, name, v in each.samples])
            for each in others
        )
        print(f"mission {place + 1}: fitted to {len(others)} others in "
              f"{time.process_time() - started_s:.0f} s", flush=True)  # fmt: skip
        for row in mission_rows(mission, model):
            rows[row.name].append(row)
    table = [mean_row(each) for each in rows.values()]
    table += real_rows(real)
    print(f"\n{'':44}{'dense':>8}{'target':>8}  {'':7}{'rmw':>7}{'CBOR':>7}{'JSON':>7}{'DCCL':>7}")
    for row in table:
        others_text = "".join(f"{each:7.1f}" for each in row.others)
        sign, verdict = ("≥" if row.is_least else "≤"), ("holds" if row.holds else "MISSED")
        print(f"{row.name:44}{row.value:8.2f}{sign:>2}{row.target:6g}  {verdict:7}{others_text}")
    print_bounds(missions)
    print_speed(missions[0])
    return 1 if arguments.strict and not all(row.holds for row in table) else 0


def mission_rows(mission: Recording | Mission, model: Model) -> Iterable[Row]:
    """Measure one mission."""
    types, samples = mission.types, mission.samples
    codec = DenseCodec(by_id(types), model=model)
    windows = _windows(samples)
    counters = exchange(codec, windows)
    sizes = [[size(types[name], value) for _, name, value in samples if name in UPLINK]
             for size in OTHERS]  # fmt: skip
    per_window = [sum(each) / len(windows) for each in sizes]
    yield Row("10 s uplink window, mean B", counters.mean, 48, others=per_window)
    yield Row("10 s uplink window, p95 B", counters.p95, 58)
    wrong, undecodable = counters.wrong, counters.undecodable
    for label, names, ack, target in (
        ("mix per 64-byte frame, no feedback", UPLINK, None, 14.5),
        ("mix per 64-byte frame, acknowledged", UPLINK, 1, 18),
        ("nav per 64-byte frame, no feedback", ("nav",), None, 11),
    ):
        full = exchange(codec, _chunks(dense_samples(samples, names)), room=FRAME_BYTES,
                        ack_every=ack)  # fmt: skip
        yield Row(label, _mean(_full(full.messages)), target, is_least=True)
    over = 0
    for name, ack, loss, target in (
        ("nav", 1, 0.0, 7.6),
        ("nav", 1, 0.1, 7.6),
        *((name, ACK_EVERY, 0.0, target) for name, target in OWN_FRAME.items()),
    ):
        alone = [[each] for each in dense_samples(samples, (name,))]
        counters = exchange(codec, alone, ack_every=ack, loss=loss)
        wrong, undecodable = wrong + counters.wrong, undecodable + counters.undecodable
        own = [value for _, stream, value in samples if stream == name]
        packed = PackedCodec(types[name])
        over = max(over, *(size - len(packed.encode(value))
                           for size, value in zip(counters.sizes, own, strict=True)))  # fmt: skip
        text = f"{name} own frame, ack every {ack}, {loss:.0%} loss"
        others = [_mean([size(types[name], value) for value in own]) for size in OTHERS]
        yield Row(f"{text}, mean B", counters.mean, target, others=others)
        if name == "nav":
            yield Row(f"{text}, p95 B", counters.p95, 11)
    yield Row("worst message less packed, B", over, 2)
    navs = [value for _, name, value in samples if name == "nav"]
    for way in WAYS:
        yield Row(f"nav {way.name}: s / packed", airtime_share(types["nav"], navs, way), 1)
    prior = model.streams[str(STREAM_IDS["nav"])]
    for label, target, each in (("fitted", 39, prior), ("online", 46, None)):
        yield Row(
            f"nav from the previous one, {label}, bits", cost(types["nav"], navs, each), target
        )
    for loss in LOSSES:
        counters = exchange(codec, windows, ack_every=1, loss=loss, disorder=0.1, seed=2)
        wrong, undecodable = wrong + counters.wrong, undecodable + counters.undecodable
    yield Row("undecodable among received", undecodable, 0)
    yield Row("decoded wrongly", wrong, 0)


def airtime_share(type_spec: TypeSpec, values: Sequence[dict[str, object]], way: Way) -> float:
    """Airtime of a sample that arrives, at 10 % loss, all included, as a share of packed."""
    step = max(1, int(way.period_s // _NAV_PERIOD_S))
    dense, packed = (
        [cross(type_spec, values[::step], codec, way, loss=0.1, seed=seed) for seed in (1, 2)]
        for codec in ("dense", "packed")
    )
    found = [
        sum(each.airtime_s for each in crossings) / sum(each.delivered for each in crossings)
        for crossings in (dense, packed)
    ]
    return found[0] / found[1]


def real_rows(recordings: Sequence[Recording]) -> Iterable[Row]:
    """Measure logs of real vehicles, online."""
    ratios = []
    for recording in recordings:
        for name, type_spec in recording.types.items():
            values = [value for _, stream, value in recording.samples if stream == name]
            bits, laplace = cost(type_spec, values), LaplaceCoder(type_spec)
            plain = _mean([each for value in values if (each := laplace.bits(value)) is not None])
            ratios.append(bits / plain)
            label = f"{recording.name[:20]} {name}"
            yield Row(f"{label}, {bits:.1f} bits / Laplace", bits / plain, 1)
            if name == "nav":
                target = 0.42 if recording.name.startswith(GLIDERS) else 0.56
                yield Row(f"{label}, bits / DCCL", bits / dccl_bits(type_spec, values[0]), target)
    if ratios:
        yield Row("real logs, mean of bits / Laplace", _mean(ratios), 0.88)


def cost(
    type_spec: TypeSpec, values: Sequence[dict[str, object]], prior: StreamPrior | None = None
) -> float:
    """Bits of a sample given the one before it, the first left out."""
    codec, writer, state, first = StreamCodec(1, type_spec, prior), Writer(), None, 0
    for value in values:
        state = codec.write(writer, codec.split(value), state, 1, {})
        first = first or writer.bits
    return (writer.bits - first) / (len(values) - 1)


def mean_row(rows: Sequence[Row]) -> Row:
    """The mean over missions; of what must not happen, the worst."""
    first, values = rows[0], [row.value for row in rows]
    is_worst = first.target in (0, 2)
    others = [_mean(column) for column in zip(*(row.others for row in rows), strict=True)]
    return msgspec.structs.replace(
        first, value=max(values) if is_worst else _mean(values), others=others
    )


def print_bounds(missions: Sequence[Recording | Mission]) -> None:
    """Print the bound of each message, bytes."""
    print()
    for name in BOUNDED:
        found = [bound_bytes(each.types[name], values_of(each, name)) for each in missions]
        print(f"bound of {name}: {_mean(found):.1f} B")


def values_of(mission: Recording | Mission, name: str) -> list[dict[str, object]]:
    """Return the samples of a stream."""
    return [value for _, stream, value in mission.samples if stream == name]


def print_speed(mission: Recording | Mission) -> None:
    """Print what encoding and decoding costs of processor time."""
    samples = dense_samples(mission.samples, ("nav",))[:400]
    print()
    for label, size, ack in (
        ("nav in frames of its own, each acknowledged", 1, True),
        ("nav in 64-byte frames, each acknowledged", 10, True),
        ("nav in frames of its own, no reference", 1, False),
    ):
        codec = DenseCodec(by_id(mission.types))
        groups = [samples[n : n + size] for n in range(0, len(samples), size)]
        spent_s = min(_spent_s(codec, groups, ack=ack) for _ in range(15))
        text = f"{spent_s / len(samples) * 1e6:.0f} µs a message"
        print(f"{label}: encode and decode {text} (pure Python, best of 15)")


def _spent_s(codec: DenseCodec, groups: Sequence[Sequence[DenseSample]], *, ack: bool) -> float:
    """Processor time of both ends, all that they do from samples to samples, s.

    Only the checking of what comes out is left out. Acknowledgements are known a frame later, as
    in `exchange`.
    """
    speaker, listener = Speaker(codec), Listener(codec)
    listeners = {LISTENER} if ack else ()
    spent_s, mark = 0.0, None
    for group in groups:
        started_s = time.process_time()
        encoded = speaker.encode(group, 4096, listeners)
        assert encoded is not None
        speaker.sent(encoded)
        if ack and mark is not None:
            speaker.acknowledged(LISTENER, mark)
        decoded = listener.decode(encoded.frame)
        mark = listener.mark
        spent_s += time.process_time() - started_s
        for (_, value), sample in zip(decoded.samples, group, strict=True):
            assert is_near(codec.streams[sample.stream_id].type_spec, value, sample.value)
    return spent_s


def _windows(samples: Sequence[Sample]) -> list[list[DenseSample]]:
    """The uplink's samples, those of ten seconds together."""
    windows: dict[int, list[DenseSample]] = defaultdict(list)
    times = [t for t, name, _ in samples if name in UPLINK]
    for at_s, sample in zip(times, dense_samples(samples, UPLINK), strict=True):
        windows[int(at_s // WINDOW_S)].append(sample)
    return [windows[n] for n in sorted(windows)]


def _chunks(samples: Sequence[DenseSample]) -> list[list[DenseSample]]:
    """All of them as one group: frames take as many as fit."""
    return [list(samples)]


def _full(messages: Sequence[int]) -> Sequence[int]:
    """Without the last frame, which is not full."""
    return messages[:-1] or messages


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


if __name__ == "__main__":
    raise SystemExit(main())
