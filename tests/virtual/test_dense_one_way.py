"""Dense streams that fill a link on which nothing comes back are acknowledged in its pauses."""

import pytest

from tests.virtual.oneway import OneWay
from zacoustic.testing.virtual import Modem

RUN_S = 240.0


@pytest.mark.parametrize(
    "modem", [Modem(), Modem(senses_carrier=False)], ids=["senses carriers", "does not"]
)
def test_dense_streams_carry_more_than_packed_ones_without_any_answer(modem: Modem) -> None:
    packed = OneWay("packed", modem=modem).run(RUN_S)
    dense = OneWay("dense", modem=modem)
    assert dense.run(RUN_S) >= 1.4 * packed
    assert dense.wrong == 0


def test_listener_speaks_in_the_pauses_only_and_little() -> None:
    dense = OneWay("dense")
    dense.run(RUN_S)
    source, listener = dense.network.stats()
    assert listener.airtime_ns < 0.05 * source.airtime_ns
    # It does not hear the end of a run while it speaks into the pause behind that.
    assert listener.frames_received > 0.85 * source.frames_transmitted


@pytest.mark.parametrize(("period_s", "receivers"), [(10.0, 1), (0.1, 3)])
def test_nobody_makes_frames_for_acknowledgements_of_a_slow_stream_or_beside_other_listeners(
    period_s: float, receivers: int
) -> None:
    dense = OneWay("dense", period_s=period_s, receivers=receivers)
    dense.run(RUN_S)
    for listener in list(dense.network.stats())[1:]:
        assert listener.frames_transmitted <= 10


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_read_wrong_where_frames_are_lost(seed: int) -> None:
    dense = OneWay("dense", seed=seed, loss=0.2)
    assert dense.run(RUN_S) > 0
    assert dense.wrong == 0
