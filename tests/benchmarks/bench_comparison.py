"""The figures of docs/comparison.md, in its order: what can be measured or calculated here.

Held-out missions (tests/telemetry/heldout), each with a model of the two others. Sizes of DCCL and
rmw_desert follow their rules (tests/telemetry/baselines.py). ltcodecs is asked itself if it is
installed: `pip install ltcodecs==4.5.1` beside the tests. Two minutes.

    python tests/benchmarks/bench_comparison.py [SEEDS]
"""

import importlib.util
import math
import random
import statistics
import sys
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.pages.blocks import blocks_of
from tests.telemetry.baselines import cbor_map_bytes, dccl_bytes, quantised, rmw_desert_bytes
from tests.telemetry.exchange import dense_samples, exchange
from tests.telemetry.recording import Recording, recordings_in
from tests.telemetry.streams import STREAM_IDS, UPLINK, by_id
from tests.virtual.test_objects import percentage
from zacoustic.channel.profiles import profile_named
from zacoustic.core.values.dense import DenseCodec, DenseSample, Model, fit
from zacoustic.core.values.types import FieldSpec, TypeSpec

HELD_OUT: Final = Path(__file__).parents[1] / "telemetry" / "heldout"
WINDOW_S: Final = 10.0
MODEM: Final = profile_named("evologics_s2c_18_34")

OBJECT_BYTES: Final = 10_240
FULL_BPS: Final = 539.0
LOSS: Final = 0.3
ONE_WAY_S: Final = 1.0
ARQ_BATCH: Final = 16
ARQ_HEAD_BYTES: Final = 5
ARQ_ACK_BYTES: Final = 8

Size = Callable[[TypeSpec, Mapping[str, Any]], int]


def main() -> int:
    """Print the tables."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    missions = recordings_in(HELD_OUT)
    models = [model_of([each for each in missions if each is not one]) for one in missions]

    print("one nav message in a frame of its own, bytes")
    nav = {
        "zacoustic, dense, acknowledged, 10 % loss": mean(map(dense_nav, missions, models)),
        "DCCL's rules": mean_size(missions, dccl_bytes),
        "ltcodecs": mean_size(missions, ltcodecs_bytes) if has_ltcodecs() else None,
        "rmw_desert's rules": mean_size(missions, rmw_desert_bytes),
    }
    for name, size in nav.items():
        print(f"  {name:44}{'not installed' if size is None else f'{size:.1f}'}")

    print("the report of ten seconds in one frame, bytes")
    print(f"  {'zacoustic, dense':44}{mean(map(dense_report, missions, models)):.0f}")
    for name, rules in (("fields of fixed width, as DCCL has them", dccl_bytes),
                        ("rmw_desert's rules", rmw_desert_bytes),
                        ("CBOR maps", cbor_map_bytes)):  # fmt: skip
        print(f"  {name:44}{mean(report(mission, rules) for mission in missions):.0f}")

    print("one nav message on the air, s: 0.150 s and 11.1 ms for each byte")
    for name, size in nav.items():
        if size is not None:
            print(f"  {f'{name}, {math.ceil(size)} bytes':54}"
                  f"{MODEM.airtime_s(math.ceil(size)):.2f}")  # fmt: skip

    print("10 KiB at 30 % loss, 1 s of sound, share of 539 bit/s, %")
    ours = mean(percentage(seed, LOSS, exclusive=False) for seed in range(seeds))
    print(f"  {f'zacoustic, listen windows, {seeds} runs':46}{ours:.0f}")
    print(f"  {'batches of 16 and acknowledgements, 400 runs':46}{mean(map(arq, range(400))):.0f}")

    print("publish nav on one side, print it on the other, lines")
    print(f"  {'zacoustic, Python with a file':44}{lines_of_the_front_page()}")
    return 0


def lines_of_the_front_page() -> int:
    """Count the lines of its program, without blank ones and comments."""
    (program,) = (block for block in blocks_of("README.md") if block.name == "depth.py")
    return len([line for line in program.text.splitlines() if line and not line.startswith("#")])


def model_of(missions: Sequence[Recording]) -> Model:
    """Fit a model to missions."""
    return fit(
        (by_id(each.types), [(t, STREAM_IDS[name], v) for t, name, v in each.samples])
        for each in missions
    )


def dense_nav(mission: Recording, model: Model) -> float:
    """Return the mean size of a frame with one nav message, every frame acknowledged."""
    alone = [[each] for each in dense_samples(mission.samples, ("nav",))]
    codec = DenseCodec(by_id(mission.types), model=model)
    counters = exchange(codec, alone, ack_every=1, loss=0.1)
    assert counters.wrong == counters.undecodable == 0
    return counters.mean


def dense_report(mission: Recording, model: Model) -> float:
    """Return the mean size of a frame with ten seconds of reports, without acknowledgements."""
    windows: dict[int, list[DenseSample]] = defaultdict(list)
    times = [t for t, name, _ in mission.samples if name in UPLINK]
    for at_s, sample in zip(times, dense_samples(mission.samples, UPLINK), strict=True):
        windows[int(at_s // WINDOW_S)].append(sample)
    return exchange(DenseCodec(by_id(mission.types), model=model), list(windows.values())).mean


def report(mission: Recording, size: Size) -> float:
    """Return the mean size of ten seconds of reports, each message by itself."""
    windows: dict[int, int] = defaultdict(int)
    for t, name, value in mission.samples:
        if name in UPLINK:
            windows[int(t // WINDOW_S)] += size(mission.types[name], value)
    return mean(windows.values())


def mean_size(missions: Sequence[Recording], size: Size) -> float:
    """Return the mean size of a nav message of other systems."""
    return mean(
        size(mission.types["nav"], value)
        for mission in missions
        for _, name, value in mission.samples
        if name == "nav"
    )


def has_ltcodecs() -> bool:
    """Tell whether ltcodecs is here."""
    return importlib.util.find_spec("ltcodecs") is not None


def ltcodecs_bytes(type_spec: TypeSpec, value: Mapping[str, Any]) -> int:
    """Let ltcodecs encode a value: a codec of numbers with a resolution for each field.

    A byte is added that says which message it is: the library has none.
    """
    linspace: Any = importlib.import_module("ltcodecs.linspace_float_codec").LinspaceFloatCodec
    rounded = quantised(type_spec, value)
    bits = sum(
        len(linspace(*bounds(field), resolution=field.step).encode(rounded[field.name])[0])
        for field in type_spec.fields
    )
    return 1 + (bits + 7) // 8


def bounds(field: FieldSpec) -> tuple[float, float]:
    """Return the range of a field that has one."""
    assert field.range is not None
    return field.range


def arq(seed: int) -> float:
    """Send an object by a plain protocol; return the share of the bit rate, %.

    As many frames as a batch has, of those that are not known to have arrived; then the sender
    listens. An acknowledgement lists what is there. When none comes, a short frame asks for it.
    """
    rng = random.Random(seed)
    frame_s = MODEM.airtime_s(MODEM.mtu_bytes) + MODEM.gap_s
    short_s = MODEM.airtime_s(ARQ_ACK_BYTES) + MODEM.gap_s
    waiting = set(range(-(-OBJECT_BYTES // (MODEM.mtu_bytes - ARQ_HEAD_BYTES))))
    absent, took_s = set(waiting), 0.0
    while waiting:
        sent = sorted(waiting)[:ARQ_BATCH]
        arrived = {each for each in sent if rng.random() >= LOSS}
        absent -= arrived
        is_asked = bool(arrived)
        took_s += len(sent) * frame_s + ONE_WAY_S
        while True:
            took_s += short_s + ONE_WAY_S
            if is_asked and rng.random() >= LOSS:
                break
            took_s += short_s + ONE_WAY_S
            is_asked = rng.random() >= LOSS
        waiting &= absent
    return 100 * OBJECT_BYTES * 8 / took_s / FULL_BPS


mean = statistics.fmean


if __name__ == "__main__":
    raise SystemExit(main())
