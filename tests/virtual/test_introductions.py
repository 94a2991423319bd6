"""Getting to know each other costs no sample: a confirmation is not said into what is coming."""

from functools import partial

from tests.virtual.fleet import line
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

NODES = {1: "shore", 2: "auv1"}
REPORTS = 8


def fleet() -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=1, name="report", publishers=(2,)),
            TopicSpec(stream_id=2, name="command", publishers=(1,), subscribers=(2,)),
        ],
        nodes=NODES,
    )


def test_hardly_anything_is_lost_between_who_reports_and_who_answers_reports() -> None:
    lost = {tenths: _lost_reports(tenths / 10) for tenths in range(25, 85)}
    # A confirmation goes at a random instant behind a report, seldom under the next one.
    assert max(lost.values()) <= 1
    assert sum(lost.values()) <= 0.01 * REPORTS * len(lost)


def _lost_reports(period_s: float) -> int:
    # 1000 m: a report of 20 bytes is heard 1.04 s after its beginning, whenever the next one comes.
    medium = VirtualNetwork(line(0, 1000, channel="none"), fleet())
    for number in range(REPORTS):
        report = b"report %02d, 20 bytes." % number
        medium.at(number * period_s, partial(medium.publish, 2, 1, report))
    # The first command is too early to confirm what the first report has introduced.
    for number in range(1, REPORTS, 2):
        # A report is spread by a quarter of its period at most.
        medium.at((number + 0.25) * period_s + 1.2, partial(medium.publish, 1, 2, b"go"))
    medium.run(until_s=60 + REPORTS * period_s)
    assert len(medium.samples(2, 2)) == REPORTS // 2
    return REPORTS - len(medium.samples(1, 1))


def test_nodes_that_can_never_be_sure_confirm_each_other_ever_less_often() -> None:
    # Without a list nobody knows who hears a broadcast, so each begins with HELLO or TAG for ever.
    table = StreamTable([TopicSpec(stream_id=1, name="report")])
    medium = VirtualNetwork(line(0, 500, channel="none"), table)
    reports = 360
    for number in range(reports):
        medium.at(10 * number, partial(medium.publish, 1, 1, b"x"))
        medium.at(10 * number + 5, partial(medium.publish, 2, 1, b"y"))
    medium.run(until_s=10 * reports + 100)
    for stats in medium.stats():
        assert stats.frames_transmitted <= reports + 20
