from zacoustic.core.base.qos import Forward, Qos
from zacoustic.core.streams.specs import ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.run.journal.forgotten import forgotten

SPECS: list[StreamSpec] = [
    TopicSpec(stream_id=1, name="nav"),
    TopicSpec(stream_id=2, name="log", journal=True),
    ServiceSpec(stream_id=3, name="arm", server=2),
    ServiceSpec(stream_id=4, name="ping", server=2, journal=False),
    ServiceSpec(stream_id=5, name="elsewhere", server=1),
]


def test_streams_that_lose_something_by_a_restart_are_named() -> None:
    assert forgotten(StreamTable(SPECS), 2) == (
        "no journal, so a restart forgets calls of arm (one may run twice) and samples of log"
    )
    assert forgotten(StreamTable(SPECS), 3) == "no journal, so a restart forgets samples of log"
    wanted = TopicSpec(
        stream_id=6, name="view", publishers=(3,), qos=Qos(forward=Forward.ON_DEMAND)
    )
    assert forgotten(StreamTable([wanted]), 2) == ""
    assert forgotten(StreamTable([wanted]), 3) == (
        "no journal, so a restart forgets the subscribers of view "
        "(until it publishes and they hear that)"
    )


def test_nothing_is_said_where_nothing_is_lost() -> None:
    assert forgotten(StreamTable([SPECS[0], SPECS[3], SPECS[4]]), 2) == ""
