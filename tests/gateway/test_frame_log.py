"""The frames that the health report shows, of a node with a list of links."""

from typing import Any

from tests.virtual.surfacing import AUV, LOG, PERIOD_S, Surfacing, table
from zacoustic.core.base.trace import TraceRecord
from zacoustic.status.channel import FrameRow
from zacoustic.zenoh.gateway.status.channel import FrameLog


def test_each_frame_is_shown_once_with_its_streams_and_the_airtime_of_its_link() -> None:
    trial = Surfacing(digest=False)
    log = FrameLog(table(), lambda: trial.network.engine(AUV), unix_s=lambda: trial.now_s)
    shown: list[FrameRow] = []

    def take(record: TraceRecord) -> None:
        if record.node == AUV:
            log.note(record)
            document: Any = log.documents()["channel"]
            shown.extend(each for each in document.last if each not in shown)

    trial.observe(take)
    for at_s in (20.0, 60.0, PERIOD_S / 2):
        trial.publish_at(at_s, LOG, b"l%d" % at_s)
    trial.network.run(until_s=PERIOD_S - 100.0)
    sent = [each for each in shown if each.way == "out"]
    assert len(sent) == sum(node == AUV for _, node, _, _ in trial.frames)
    above = [each for each in sent if 50.0 < each.begun_unix_s < 100.0 and each.streams == ["log"]]
    below = [each for each in sent if each.begun_unix_s > 200.0 and each.streams == ["log"]]
    assert [each.airtime_s < 0.01 for each in above] == [True]  # by radio, once it was answered
    assert below[-1].airtime_s > 0.2
