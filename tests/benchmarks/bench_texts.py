"""Texts, JSON and CBOR without a type: bytes as they are, by zlib, packed, in dense blocks.

Telemetry of missions as a publisher without a schema would write it, numbers with as many decimals
as their step has. zlib is raw deflate, a sample at a time; with the dictionary it knows the texts
that the package ships, as `packed` does. *dense* is a frame for each, all acknowledged. The last
rows have names that nobody knows beforehand. Every payload is decoded and compared.

    python -m tests.benchmarks.bench_texts [FOLDER]
"""

import argparse
import json
import math
import sys
import time
import zlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

# Run as a file, as `make bench` does, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

import cbor2

from tests.telemetry.exchange import LISTENER
from tests.telemetry.mission import Mission
from tests.telemetry.recording import Recording, recordings_in
from zacoustic.core.values.dense import DenseCodec, DenseSample, Listener, Speaker
from zacoustic.core.values.dense.stream.packedbytes import PackedBytesCodec
from zacoustic.core.values.dense.text.examples import payload_examples
from zacoustic.core.values.dense.text.lines import LINES
from zacoustic.core.values.types import FieldSpec, TypeSpec

OCTETS: Final = TypeSpec(name="Octets", fields=(FieldSpec(name="octets", type="bytes"),))
DICTIONARY: Final = b"\n".join([*(line.encode() for line in LINES), *payload_examples()])
MOST: Final = 150
"""So many samples of each kind and mission."""


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, help="recordings, *.jsonl.gz")
    folder = parser.parse_args().folder
    missions: list[Recording | Mission] = [
        each for each in (recordings_in(folder) if folder else []) if not each.is_real
    ] or [Mission(seed) for seed in (1, 2)]
    kinds: dict[str, list[list[bytes]]] = defaultdict(list)
    for mission in missions:
        found: dict[str, list[bytes]] = defaultdict(list)
        for name, octets in _payloads(mission):
            if len(found[name]) < MOST:
                found[name].append(octets)
        for name, payloads in found.items():
            kinds[name].append(payloads)
    head = ("as it is", "zlib", "zlib+dict", "packed", "dense", "us/byte")
    print(f"{'mean bytes':16}" + "".join(f"{each:>11}" for each in head))
    for name, groups in sorted(kinds.items()):
        everything = [octets for group in groups for octets in group]
        packed, us_per_byte = _packed(everything)
        row = (
            _mean([len(octets) for octets in everything]),
            _mean([_deflated(octets, b"") for octets in everything]),
            _mean([_deflated(octets, DICTIONARY) for octets in everything]),
            packed,
            _mean([size for group in groups for size in _dense(group)]),
            us_per_byte,
        )
        print(f"{name:16}" + "".join(f"{each:11.1f}" for each in row))
    return 0


def _payloads(mission: Recording | Mission) -> Iterator[tuple[str, bytes]]:
    for _, name, value in mission.samples:
        if name == "log":
            yield "log line", value["text"].encode()
            continue
        rounded = _rounded(mission.types[name], value)
        yield f"{name} JSON", json.dumps(rounded, separators=(",", ":")).encode()
        yield f"{name} CBOR", cbor2.dumps(rounded)
        if name in ("nav", "ctd"):
            strange = {_strange(key): each for key, each in rounded.items()}
            yield f"{name} JSON strange", json.dumps(strange, separators=(",", ":")).encode()


def _rounded(type_spec: TypeSpec, value: dict[str, Any]) -> dict[str, Any]:
    found = {}
    for field in type_spec.fields:
        number = value[field.name]
        if field.step is not None and not field.is_integer:
            number = round(number, max(0, math.ceil(-math.log10(field.step))))
        found[field.name] = number
    return found


def _strange(name: str) -> str:
    """A name of the same length that means nothing."""
    return name.translate(str.maketrans("abcdefghijklmnopqrstuvwxyz", "qwzxkvjbpfgyhmcdtnlsoeirua"))


def _deflated(octets: bytes, dictionary: bytes) -> int:
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15, 9, zdict=dictionary)
    return len(deflate.compress(octets) + deflate.flush())


def _packed(everything: Sequence[bytes]) -> tuple[float, float]:
    codec, total = PackedBytesCodec(), 0
    codec.encode(b"the model is made")
    started_s = time.process_time()
    for octets in everything:
        payload = codec.encode(octets)
        total += len(payload)
        if codec.decode(payload) != octets:
            raise SystemExit(f"decoded wrongly: {octets!r}")
    took_s = time.process_time() - started_s
    return total / len(everything), took_s * 1e6 / sum(map(len, everything))


def _dense(group: Sequence[bytes]) -> list[int]:
    codec = DenseCodec({1: OCTETS})
    speaker, listener, sizes = Speaker(codec), Listener(codec), []
    for tick, octets in enumerate(group):
        encoded = speaker.encode([DenseSample(1, {"octets": octets}, tick)], 1 << 16, {LISTENER})
        assert encoded is not None
        speaker.sent(encoded)
        decoded = listener.decode(encoded.frame)
        if decoded.samples[0][1]["octets"] != octets:
            raise SystemExit(f"decoded wrongly: {octets!r}")
        speaker.acknowledged(LISTENER, decoded.snapshot.mark)
        sizes.append(len(encoded.frame))
    return sizes


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


if __name__ == "__main__":
    raise SystemExit(main())
