"""The seal of a node, driven from outside: nonces, replays, kills, strangers."""

import random
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.peers.sealing import ANSWERED, USUAL, Inside, LongHeads, Seal, SealRefusal
from zacoustic.core.wire.seal import (
    LAST_COUNTER,
    LAST_LIFE,
    NEVER_FIRST,
    NO_TABLE,
    Cipher,
    LongHead,
    ShortHead,
    Way,
    nonce,
    parse_sealed,
)
from zacoustic.seal.ccm import FleetCipher
from zacoustic.seal.keys import new_key

KEY = new_key("test")
DIGEST, OTHER = b"\1\2\3\4", b"\4\3\2\1"
SECOND = 1_000_000_000


def make(
    address: int,
    life: int,
    journal: JournalPort,
    stored: Mapping[str, bytes],
    cipher: Cipher | None = None,
    announced: Mapping[int, bytes] = MappingProxyType({}),
) -> Seal:
    return Seal(
        address, life, cipher or FleetCipher(KEY), journal, stored,
        lambda source: announced.get(source, b""),
    )  # fmt: skip


class Receiver:
    """A node that opens frames, and can be killed at any instant."""

    def __init__(self, address: int, rng: random.Random) -> None:
        self.address = address
        self.rng = rng
        self.disk: dict[str, bytes] = {}
        self.handed_on: list[bytes] = []
        self.refused: list[SealRefusal] = []
        self.now = 0
        self.start()

    def start(self) -> None:
        self.journal = JournalPort()
        self.announced: dict[int, bytes] = {}
        self.seal = make(self.address, 7, self.journal, self.disk, announced=self.announced)

    def take(self, frame: bytes, way: Way) -> None:
        def hand_on(inside: Inside, now: int) -> None:
            self.handed_on.append(inside.records)

        refusal = self.seal.open(frame, way, DIGEST, self.now, hand_on)
        if refusal is not None:
            self.refused.append(refusal)

    def commit(self, most: int = 1_000_000) -> None:
        while most and (write := self.journal.poll()) is not None:
            most -= 1
            assert write.value is not None
            self.disk[write.key] = write.value
            self.journal.committed(write.write_id, 0)

    def kill(self) -> None:
        self.commit(self.rng.randrange(4))
        self.start()


def sender(life: int = 1, address: int = 1) -> Seal:
    return make(address, life, JournalPort(), {})


@given(
    life=st.integers(0, LAST_LIFE),
    counter=st.integers(0, LAST_COUNTER),
    strong=st.booleans(),
    generation=st.integers(0, 1),
)
def test_heads_come_back_and_never_begin_like_an_extension(
    life: int, counter: int, strong: bool, generation: int
) -> None:
    for head in (LongHead(generation, life, counter, strong), ShortHead(generation, counter % 64)):
        frame = head.encode() + bytes(8)
        assert frame[0] != NEVER_FIRST
        sealed = parse_sealed(frame)
        assert sealed is not None
        assert sealed.head == head
        assert sealed.body == bytes(8)


@given(st.binary(max_size=64))
def test_any_bytes_are_a_frame_or_none(frame: bytes) -> None:
    sealed = parse_sealed(frame)
    assert sealed is None or sealed.head_bytes + sealed.body == frame


def test_no_two_ways_share_a_nonce() -> None:
    ways = [
        Way(source, destination, port, strong)
        for source in (1, 2)
        for destination in (1, 255)
        for port in (0, 127)
        for strong in (False, True)
    ]
    made = [nonce(way, life, counter) for way in ways for life in (0, 1) for counter in (0, 1)]
    assert len(set(made)) == len(made)
    assert {len(each) for each in made} == {13}


def test_what_is_sealed_is_opened_once_under_the_digest_of_its_table() -> None:
    seal, seen = sender(), Receiver(2, random.Random(1))
    seal_way = Way(1, 255)
    plain = seal.seal(b"nav", 255, DIGEST, 0)
    free = seal.seal(b"stop", 255, NO_TABLE, 0, strong=True)
    for _ in range(2):
        seen.take(plain, seal_way)
        seen.take(free, seal_way)
        seen.commit()
    assert seen.handed_on == [b"nav", b"stop"]
    assert seen.refused == [SealRefusal.REPLAYED] * 2
    assert (len(plain), len(free)) == (5 + 3 + 4, 5 + 4 + 8)
    assert len(seal.seal(b"nav", 255, DIGEST, 0)) == 1 + 3 + 4


def test_the_table_of_a_source_is_told_by_its_tag() -> None:
    seal, receiver = sender(), Receiver(2, random.Random(1))
    opened: list[bytes] = []
    frame = seal.seal(b"x", 2, OTHER, 0)

    def note(inside: Inside, now: int) -> None:
        opened.append(inside.digest)

    assert receiver.seal.open(frame, Way(1, 2), DIGEST, 0, note) is SealRefusal.FORGED
    receiver.announced[1] = OTHER
    assert receiver.seal.open(frame, Way(1, 2), DIGEST, 0, note) is None
    receiver.commit()
    assert opened == [OTHER]


def test_another_way_opens_nothing() -> None:
    frame, receiver = sender().seal(b"x", 2, DIGEST, 0), Receiver(2, random.Random(1))
    for way in (Way(3, 2), Way(1, 255), Way(1, 2, 1)):
        receiver.take(frame, way)
    assert receiver.refused == [SealRefusal.FORGED] * 3


def test_a_former_life_is_told() -> None:
    receiver = Receiver(2, random.Random(1))
    old, new = sender(4).seal(b"old", 2, DIGEST, 0), sender(5).seal(b"new", 2, DIGEST, 0)
    for frame in (new, old):
        receiver.take(frame, Way(1, 2))
    receiver.take(sender(4).seal(b"old", 255, DIGEST, 0), Way(1, 255))  # never heard there
    receiver.commit()
    assert receiver.handed_on == [b"new"]
    assert receiver.refused == [SealRefusal.FORMER_LIFE, SealRefusal.FORMER_LIFE]


def test_another_computer_with_the_same_key_and_address_silences_the_older_one() -> None:
    seal, way = sender(4, address=2), Way(2, 255)
    echo = seal.seal(b"x", 255, DIGEST, 0)
    former = sender(3, address=2).seal(b"x", 255, DIGEST, 0)
    forged = echo[:-1] + bytes((echo[-1] ^ 1,))
    ahead = sender(5, address=2).seal(b"x", 255, DIGEST, 0)
    broken = ahead[:-1] + bytes((ahead[-1] ^ 1,))
    for frame in (echo, former, forged, broken, b"", b"\x00"):
        assert seal.overhear_own(frame, way, DIGEST) is None
    assert seal.may_seal
    assert seal.overhear_own(ahead, way, DIGEST) is SealRefusal.CLONE
    assert not seal.may_seal
    younger = sender(5, address=2)
    assert younger.overhear_own(echo, way, DIGEST) is None
    assert younger.may_seal


def test_a_new_key_begins_lives_anew_and_its_first_frame_says_so() -> None:
    receiver, way = Receiver(2, random.Random(1)), Way(1, 2)
    cipher = FleetCipher(KEY)
    seal = make(1, 5, JournalPort(), {}, cipher)
    receiver.take(seal.seal(b"old", 2, DIGEST, 0), way)
    late = seal.seal(b"late", 2, DIGEST, 0)
    receiver.commit()
    rotated = KEY.rotated()
    receiver.journal = JournalPort()
    receiver.seal = make(2, 7, receiver.journal, receiver.disk, FleetCipher(rotated))
    fresh = make(1, 0, JournalPort(), {}, FleetCipher(rotated))
    for frame in (fresh.seal(b"new", 2, DIGEST, 0), late, fresh.seal(b"next", 2, DIGEST, 0)):
        receiver.take(frame, way)
        receiver.commit()
    assert receiver.handed_on == [b"old", b"new", b"next"]


def frames_of(seal: Seal, rng: random.Random) -> Iterator[tuple[bytes, Way, bytes]]:
    """Return frames of one life, for a node and for all, with records that occur once."""
    number, now = 0, 0
    while True:
        number += 1
        now += rng.randrange(1, 20) * SECOND
        destination, strong = rng.choice((2, 255)), rng.random() < 0.2
        records, port = rng.randbytes(6) + number.to_bytes(4, "big"), rng.randrange(2)
        frame = seal.seal(records, destination, DIGEST, now, port=port, strong=strong)
        yield frame, Way(seal._address, destination, port), records


def test_nothing_is_handed_on_twice_whenever_a_receiver_is_killed(
    count: Callable[[int], int],
) -> None:
    rng = random.Random(11)
    receiver = Receiver(2, rng)
    sent: list[tuple[bytes, Way]] = []
    kills, life, offered = 0, 0, 0
    while kills < count(10_000):
        life += 1
        frames = frames_of(sender(life), rng)
        for _ in range(rng.randrange(1, 60)):
            frame, way, _ = next(frames)
            sent.append((frame, way))
            receiver.now += rng.choice((SECOND // 10, SECOND, 8 * SECOND))
            if rng.random() >= 0.3:
                receiver.take(frame, way)
            for old_frame, old_way in rng.choices(sent[-2000:], k=10):
                offered += 1
                receiver.take(old_frame, old_way)
            if rng.random() < 0.6:
                receiver.commit(rng.randrange(1, 5))
            if rng.random() < 0.1:
                kills += 1
                receiver.kill()
    receiver.commit()
    assert len(set(receiver.handed_on)) == len(receiver.handed_on)
    assert len(receiver.handed_on) > 0.4 * len(sent)
    assert offered > 9 * len(sent)


@pytest.mark.parametrize("strong", [False, True])
def test_after_a_power_cut_the_first_command_is_heard(
    strong: bool, count: Callable[[int], int]
) -> None:
    """Strong frames lose nothing; others at most what a mark runs ahead."""
    for seed in range(count(1000)):
        rng = random.Random(seed)
        receiver, seal = Receiver(2, rng), sender()
        for number in range(rng.randrange(1, 40)):
            receiver.take(seal.seal(b"%d" % number, 2, DIGEST, 0, strong=strong), Way(1, 2))
            receiver.commit()
        receiver.kill()
        before, missed = len(receiver.handed_on), 0
        while len(receiver.handed_on) == before:
            receiver.take(seal.seal(b"after", 2, DIGEST, 0, strong=strong, long=True), Way(1, 2))
            receiver.commit()
            missed += 1
        assert missed == 1 if strong else missed <= 17


def test_a_hearer_in_step_stays_so_among_rare_long_heads(count: Callable[[int], int]) -> None:
    for seed in range(count(1000)):
        rng = random.Random(seed)
        receiver, seal, way = Receiver(2, rng), sender(), Way(1, 2)
        loss = rng.choice((0.0, 0.3, 0.6, 0.9))
        long_heads = lost_in_a_row = 0
        for number in range(4 * ANSWERED.every):
            frame = seal.seal(b"fragment", 2, DIGEST, 0, long_heads=ANSWERED)
            long_heads += len(frame) == 5 + 8 + 4
            if number and rng.random() < loss and lost_in_a_row < ANSWERED.every:
                lost_in_a_row += 1
                continue
            heard, lost_in_a_row = len(receiver.handed_on), 0
            receiver.take(frame, way)
            receiver.commit()
            assert len(receiver.handed_on) == heard + 1, (seed, number)
        assert long_heads == 4


@pytest.mark.parametrize("heads", [USUAL, ANSWERED])
def test_in_step_again_soon_after_any_blackout(
    heads: LongHeads, count: Callable[[int], int]
) -> None:
    for seed in range(count(1000)):
        rng = random.Random(seed)
        receiver, seal, way = Receiver(2, rng), sender(), Way(1, 2)
        receiver.take(seal.seal(b"first", 2, DIGEST, 0), way)
        receiver.commit()
        for _ in range(rng.choice((1, 15, 64, 100, 1000))):
            seal.seal(b"lost", 2, DIGEST, 0, long_heads=heads)
        heard = len(receiver.handed_on)
        for _ in range(heads.every):
            receiver.take(seal.seal(b"after", 2, DIGEST, 0, long_heads=heads), way)
            receiver.commit()
        assert len(receiver.handed_on) > heard, seed
        heard = len(receiver.handed_on)
        for _ in range(50):
            receiver.take(seal.seal(b"then", 2, DIGEST, 0, long_heads=heads), way)
            receiver.commit()
        assert len(receiver.handed_on) == heard + 50
