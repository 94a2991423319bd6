"""What the events of an engine say: a line of text, and the members in JSON."""

import json
from types import SimpleNamespace
from typing import Any, Final

import msgspec
import pytest

from zacoustic.core.base.qos import Priority
from zacoustic.core.bond.reach import Reach
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine import events
from zacoustic.core.linktypes import LinkState
from zacoustic.core.peers.ranging import RangeFailed, RangeFailure
from zacoustic.core.peers.sealing import SealRefusal
from zacoustic.core.profiles.entities import EntityKind, RosEntitySeen
from zacoustic.core.schedule.access.base import AccessState, SlotFault, Trouble
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.zenoh.gateway.events.said import TOLD, said

NAV: Final = 10
AT: Final = 1_000 * NS_PER_S


class Runner:
    """A node with two links."""

    def __init__(self) -> None:
        self.sides = [SimpleNamespace(detail="waits"), SimpleNamespace(detail="in use")]
        self.engine = SimpleNamespace(
            address=1,
            table=StreamTable(
                [TopicSpec(stream_id=NAV, name="auv1/nav")], nodes={2: "auv1", 3: "buoy"}
            ),
            clock=SimpleNamespace(doubt=""),
            silence=SimpleNamespace(state=lambda now: SimpleNamespace(doubt="")),
        )

    def side(self, name: str) -> SimpleNamespace:
        return self.sides[name == "radio"]


def context_of(runner: Runner) -> Any:
    return SimpleNamespace(
        runner=runner,
        engine=runner.engine,
        clock=lambda: AT,
        utc_ns=lambda: 1_767_225_600 * NS_PER_S,
    )


LINK = events.LinkStateChanged(state=LinkState.DOWN, changed_at=AT, link="radio")
SILENCE = events.SilenceChanged(
    is_silent=True, is_commanded=True, ends_at=AT + 60 * NS_PER_S, changed_at=AT, doubt="no time"
)
FAULTS = (
    SlotFault(node=2, trouble=Trouble.OUTSIDE, by_s=0.5),
    SlotFault(node=3, trouble=Trouble.SHARED, by_s=0.0),
)
CUSTODY = events.CustodyChanged(
    delivery_id=1, stream_id=NAV, subscriber=3, custodian=2, changed_at=AT
)
SEAL = events.SealAlarm(
    address=3, refusal=SealRefusal.FORBIDDEN, frames=31, is_too_many=True, stream_id=NAV
)
LATE = events.DeadlineMissed(
    stream_id=NAV, source=2, instance=(), key="auv1/nav", side=events.DeadlineSide.REQUESTED,
    missed=4, is_first=True, last_at=0, missed_at=AT,
)  # fmt: skip
TUNED = events.StreamOverridden(
    stream_id=NAV, on=False, min_interval_s=0.05, priority=Priority.BACKGROUND, commanded_by=2,
    changed_at=AT,
)  # fmt: skip
SAID: Final[list[tuple[Any, list[str], dict[str, Any], bool]]] = [
    (
        LINK,
        ["link      radio down in use"],
        {"event": "link", "state": "down", "detail": "in use", "link": "radio"},
        True,
    ),
    (
        msgspec.structs.replace(LINK, state=LinkState.UP, link="acoustic"),
        ["link      acoustic up waits"],
        {"event": "link", "state": "up", "detail": "waits", "link": "acoustic"},
        False,
    ),
    (
        SILENCE,
        ["silence   until 2026-01-01T00:01:00.000Z (no time)"],
        {
            "event": "silence",
            "silent": True,
            "until_utc": "2026-01-01T00:01:00.000Z",
            "doubt": "no time",
        },
        False,
    ),
    (
        msgspec.structs.replace(SILENCE, ends_at=None, doubt=""),
        ["silence   until it is resumed"],
        {"event": "silence", "silent": True, "until_utc": "", "doubt": ""},
        False,
    ),
    (
        msgspec.structs.replace(
            SILENCE, is_silent=False, is_commanded=False, ends_at=None, doubt=""
        ),
        ["silence   ended"],
        {"event": "silence", "silent": False, "until_utc": "", "doubt": ""},
        False,
    ),
    (
        TUNED,
        ["tuned     10 (auv1/nav): off, every 0.05 s at most, background, by node 2"],
        {
            "event": "overridden",
            "stream_id": 10,
            "stream": "auv1/nav",
            "on": False,
            "min_interval_s": 0.05,
            "priority": "background",
            "commanded_by": 2,
        },
        False,
    ),
    (
        msgspec.structs.replace(TUNED, on=True, min_interval_s=0.0, commanded_by=0),
        ["tuned     10 (auv1/nav): on, background, by this local network"],
        {
            "event": "overridden",
            "stream_id": 10,
            "stream": "auv1/nav",
            "on": True,
            "min_interval_s": 0.0,
            "priority": "background",
            "commanded_by": 0,
        },
        False,
    ),
    (
        events.EngineRestarted(faults=2, cause="KeyError: 7", changed_at=AT),
        ["internal  error 2, please report the log; it goes on: KeyError: 7"],
        {"event": "internal_error", "faults": 2, "cause": "KeyError: 7"},
        True,
    ),
    (
        events.JournalStateChanged(failure="disk full", changed_at=AT),
        ["journal   fails, what is reliable waits: disk full"],
        {"event": "journal", "failure": "disk full"},
        True,
    ),
    (
        events.JournalStateChanged(failure="", changed_at=AT),
        ["journal   can be written again"],
        {"event": "journal", "failure": ""},
        False,
    ),
    (
        events.JournalDoubted(reason="an old copy"),
        ["journal   in doubt, a new boot epoch continues with its valid part: an old copy"],
        {"event": "journal_in_doubt", "reason": "an old copy"},
        True,
    ),
    (
        events.AddressShared(address=1),
        [
            "address   1: this one and another have it; samples of the "
            "two mix and get lost: give each its own",
        ],
        {"event": "address_shared", "address": 1, "name": "", "is_own": True},
        True,
    ),
    (
        events.AddressShared(address=3),
        [
            "address   3 buoy: two nodes have it; samples of the two mix "
            "and get lost: give each its own",
        ],
        {"event": "address_shared", "address": 3, "name": "buoy", "is_own": False},
        True,
    ),
    (
        SEAL,
        ["seal      3 buoy: it sends what it may not send: auv1/nav (31); rotate the key"],
        {
            "event": "seal",
            "address": 3,
            "name": "buoy",
            "refusal": "forbidden",
            "frames": 31,
            "is_too_many": True,
            "stream": "auv1/nav",
        },
        True,
    ),
    (
        msgspec.structs.replace(
            SEAL, refusal=SealRefusal.FORGED, stream_id=None, is_too_many=False, address=9
        ),
        ["seal      9: its frames do not open: another key, or not from it (31)"],
        {
            "event": "seal",
            "address": 9,
            "name": "",
            "refusal": "forged",
            "frames": 31,
            "is_too_many": False,
            "stream": "",
        },
        True,
    ),
    (
        events.NothingHeard(frames=20, up_at=0, changed_at=AT),
        ["unheard   20 frames sent and none heard; ask zacoustic config doctor"],
        {"event": "unheard", "frames": 20},
        True,
    ),
    (
        events.AccessStateChanged(state=AccessState(method="schedule"), changed_at=AT),
        ["access    schedule"],
        {"event": "access", "method": "schedule", "why": "", "faults": []},
        False,
    ),
    (
        events.AccessStateChanged(
            state=AccessState(method="aloha", why="no time", faults=FAULTS), changed_at=AT
        ),
        [
            "access    aloha: no time",
            "access    node 2 transmits 0.50 s outside its slots: its "
            "clock is wrong or it has others",
            "access    node 3 owns a slot of this node and is heard: they use it in turns",
        ],
        {
            "event": "access",
            "method": "aloha",
            "why": "no time",
            "faults": [[2, "outside", 0.5], [3, "shared", 0.0]],
        },
        True,
    ),
    (
        events.BulkChanged(address=2, works=True, changed_at=AT),
        ["bulk      large samples to auv1 (2) go fast again"],
        {"event": "bulk", "address": 2, "name": "auv1", "works": True},
        False,
    ),
    (
        events.BulkChanged(address=9, works=False, changed_at=AT),
        ["bulk      fast data do not get through to 9; large samples go slowly"],
        {"event": "bulk", "address": 9, "name": "", "works": False},
        True,
    ),
    (
        events.ClockStateChanged(doubt="no time", changed_at=AT),
        ["clock     nothing is transmitted: no time"],
        {"event": "clock", "doubt": "no time"},
        True,
    ),
    (
        events.ClockStateChanged(doubt="", changed_at=AT),
        ["clock     sure"],
        {"event": "clock", "doubt": ""},
        False,
    ),
    (
        events.PeerSeen(address=2, epoch=7, same_table=True, wire_version=1),
        ["peer      2 auv1 with the same table, epoch 7"],
        {
            "event": "peer",
            "address": 2,
            "name": "auv1",
            "epoch": 7,
            "same_table": True,
            "wire_version": 1,
        },
        False,
    ),
    (
        events.PeerSeen(address=3, epoch=7, same_table=False, wire_version=1),
        ["peer      3 buoy with another table, epoch 7"],
        {
            "event": "peer",
            "address": 3,
            "name": "buoy",
            "epoch": 7,
            "same_table": False,
            "wire_version": 1,
        },
        True,
    ),
    (
        events.PeerLost(address=3, heard_at=None, lost_at=AT),
        ["lost      3 buoy: not heard any more"],
        {"event": "lost", "address": 3, "name": "buoy"},
        True,
    ),
    (
        events.PeerLost(address=9, heard_at=None, lost_at=AT),
        ["lost      9: not heard any more"],
        {"event": "lost", "address": 9, "name": ""},
        True,
    ),
    (
        events.PeerFound(address=3, found_at=AT),
        ["found     3 buoy"],
        {"event": "found", "address": 3, "name": "buoy"},
        False,
    ),
    (
        events.PeerReachable(
            address=2, link="radio", bond="both", reach=Reach.DOUBT, changed_at=AT
        ),
        ["reach     2 auv1 by radio: doubt"],
        {
            "event": "reach",
            "address": 2,
            "name": "auv1",
            "link": "radio",
            "bond": "both",
            "reach": "doubt",
        },
        False,
    ),
    (
        CUSTODY,
        ["custody   auv1/nav for 3: in custody of 2"],
        {"event": "custody", "stream": "auv1/nav", "subscriber": 3, "custodian": 2, "detail": ""},
        False,
    ),
    (
        msgspec.structs.replace(CUSTODY, custodian=None, detail="no room"),
        ["custody   auv1/nav for 3: no room"],
        {
            "event": "custody",
            "stream": "auv1/nav",
            "subscriber": 3,
            "custodian": None,
            "detail": "no room",
        },
        True,
    ),
    (
        events.SubscribersChanged(stream_id=NAV, subscribers=(1, 3), changed_at=AT),
        ["wanted    auv1/nav by 1, 3"],
        {"event": "subscribers", "stream": "auv1/nav", "subscribers": [1, 3]},
        False,
    ),
    (
        events.SubscribersChanged(stream_id=NAV, subscribers=(), changed_at=AT),
        ["wanted    auv1/nav by nobody"],
        {"event": "subscribers", "stream": "auv1/nav", "subscribers": []},
        False,
    ),
    (
        LATE,
        ["late      auv1/nav of node 2: nothing has come in time (4)"],
        {"event": "late", "stream": "auv1/nav", "address": 2, "side": "requested", "missed": 4},
        True,
    ),
    (
        msgspec.structs.replace(LATE, side=events.DeadlineSide.OFFERED, source=1),
        ["late      auv1/nav of node 1: not published in time (4)"],
        {"event": "late", "stream": "auv1/nav", "address": 1, "side": "offered", "missed": 4},
        True,
    ),
    (
        events.StreamsDiffer(address=2, stream_id=NAV),
        ["differs   10 (auv1/nav) at node 2: stopped"],
        {"event": "differs", "address": 2, "stream_id": 10, "stream": "auv1/nav"},
        True,
    ),
    (
        events.StreamsDiffer(address=2, stream_id=99),
        ["differs   99 (a stream that is not in this file) at node 2: stopped"],
        {"event": "differs", "address": 2, "stream_id": 99, "stream": ""},
        True,
    ),
    (
        RangeFailed(range_id=None, address=2, failure=RangeFailure.UNAVAILABLE, text="no ranges"),
        ["ranging   node 2: no ranges"],
        {"event": "ranging", "address": 2, "text": "no ranges"},
        True,
    ),
    (
        RosEntitySeen(
            node="talker",
            namespace="/",
            kind=EntityKind.PUBLISHER,
            gid=bytes(16),
            topic="/pose",
            type="Pose",
            leaves=False,
            seen_at=AT,
        ),
        ["entity    /talker: publisher /pose Pose"],
        {
            "event": "entity",
            "node": "/talker",
            "kind": "publisher",
            "topic": "/pose",
            "type": "Pose",
            "leaves": False,
        },
        False,
    ),
    (
        RosEntitySeen(
            node="talker",
            namespace="/auv",
            kind=EntityKind.CLIENT,
            gid=bytes(16),
            topic="",
            type="",
            leaves=True,
            seen_at=AT,
        ),
        ["entity    /auv/talker: client leaves"],
        {
            "event": "entity",
            "node": "/auv/talker",
            "kind": "client",
            "topic": "",
            "type": "",
            "leaves": True,
        },
        False,
    ),
]


@pytest.mark.parametrize(("event", "lines", "record", "is_trouble"), SAID)
def test_an_event_says_itself(
    event: Any, lines: list[str], record: dict[str, Any], is_trouble: bool
) -> None:
    notice = said(event, context_of(Runner()))
    assert notice is not None
    assert notice.lines() == lines
    assert json.loads(msgspec.json.encode(notice.record())) == record
    assert notice.is_trouble == is_trouble


def test_each_event_that_is_worth_a_line_is_shown_here() -> None:
    assert {type(event) for event, *_ in SAID} == set(TOLD)


def test_a_second_missed_deadline_and_other_events_say_nothing() -> None:
    context = context_of(Runner())
    assert said(msgspec.structs.replace(LATE, is_first=False), context) is None
    assert said(events.DeliveryStored(delivery_id=1, stream_id=NAV), context) is None
