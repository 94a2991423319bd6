"""The board: the newest documents of all gateways, and the values derived from them.

Instants in documents are by the clock of the gateway's computer, which may differ from ours by
hours: a vehicle has no network time. So a gateway's answers contain its own time, and ages are
computed by its clock.
"""

import re
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final, TypeVar

import msgspec

from zacoustic.app.tools.watch.documents import (
    DOCUMENTS,
    NAMED_DOCUMENTS,
    PEER_DOCUMENTS,
    BondDocument,
    CarriedRow,
    CarryDocument,
    ChannelDocument,
    DroppedDocument,
    EventsDocument,
    FrameRow,
    JournalDocument,
    LateDocument,
    LedgerDocument,
    LinkDocument,
    LostDocument,
    ModemDocument,
    NodeDocument,
    ObjectsDocument,
    PeerRow,
    RangeDocument,
    RelayDocument,
    RouteDocument,
    StreamRow,
    StreamsDocument,
    TransferRow,
)
from zacoustic.app.tools.watch.views import (
    BondView,
    CarriedView,
    CarryView,
    CauseView,
    EventView,
    FrameView,
    GatewayView,
    HopView,
    LinkView,
    PeerView,
    ReceivedView,
    RouteView,
    StreamView,
    TransferView,
    WaitsView,
)
from zacoustic.app.tools.watch.ways import first_link
from zacoustic.core.engine.events import DeliveryOutcome
from zacoustic.zenoh.requests.request import PREFIX

WINDOW_S: Final = 60.0
"""The utilisation covers this time, s, once it was observed."""
_OVERDUE_S: Final = 2.0
"""A frame that should have gone this long ago does not count as waiting, s: a gateway publishes at
most once a second."""
MOST_NAMED: Final = 64
"""Most documents ``link/NAME`` of one gateway, most of each other kind with names, most hops."""
_DAMAGED: Final = ("check", "short", "overlong", "stuffing")
# A higher rate comes from two records of one moment.
_LEAST_PERIOD_S: Final = 0.001

# Anybody can put a key: a text with other digits than these is no address.
_ADDRESS: Final = re.compile(r"[0-9]{1,3}")

T = TypeVar("T")


def addresses_in(key: str) -> list[int]:
    """Return the address of the gateway whose document has this key; empty: none."""
    prefix, _, rest = key.partition("/")
    address = rest.partition("/")[0]
    return [int(address)] if prefix == PREFIX and _ADDRESS.fullmatch(address) else []


class Board:
    """Documents in, views out.

    Args:
        unix_s: The clock for people here, s; None: this computer's at first, then monotonic, so
            that ages never jump.
    """

    def __init__(self, unix_s: Callable[[], float] | None = None) -> None:
        self.unreadable = 0
        """Number of unreadable documents."""
        began_s = time.time() - time.monotonic()
        self._unix_s = unix_s or (lambda: began_s + time.monotonic())
        self._boards: dict[int, _GatewayBoard] = {}

    def take(self, key: str, payload: bytes) -> None:
        """Take a document; an unreadable one is counted, an unknown one is dropped.

        Args:
            key: Its key.
            payload: JSON.
        """
        chunks = key.split("/")
        if len(chunks) < 3 or not addresses_in(key):
            return
        kind: Any = None
        if len(chunks) == 3:
            kind = DOCUMENTS.get(chunks[2])
        elif len(chunks) == 4:
            kind = NAMED_DOCUMENTS.get(chunks[2])
        elif len(chunks) == 5 and chunks[2] == "peer" and _ADDRESS.fullmatch(chunks[3]):
            kind = PEER_DOCUMENTS.get(chunks[4])
        if kind is None:
            return
        try:
            document = msgspec.json.decode(payload, type=kind)
        except msgspec.MsgspecError:
            self.unreadable += 1
            return
        board = self._boards.setdefault(int(chunks[1]), _GatewayBoard(int(chunks[1])))
        board.take("/".join(chunks[2:]), document, self._unix_s())

    def note_alive(self, address: int, *, is_alive: bool) -> None:
        """Note that a gateway has appeared or disappeared."""
        board = self._boards.setdefault(address, _GatewayBoard(address))
        board.note_alive(is_alive, self._unix_s())

    def note_answer(self, address: int, *, has_answered: bool) -> None:
        """Note whether a gateway has answered that it runs."""
        self._boards[address].note_answer(has_answered, self._unix_s())

    def addresses(self) -> list[int]:
        """Return the addresses of known gateways, in order."""
        return sorted(address for address, board in self._boards.items() if board.has_documents)

    def view(self, address: int) -> GatewayView:
        """Return the present view of a gateway."""
        return self._boards[address].view(self._unix_s())

    def views(self) -> list[GatewayView]:
        """Return the present views of all gateways."""
        return [self.view(address) for address in self.addresses()]


class _GatewayBoard:
    """The documents of one gateway."""

    def __init__(self, address: int) -> None:
        self.address = address
        self._is_there = True
        self._answers = True
        self._gone_at_s: float | None = None
        self._documents: dict[str, Any] = {}
        self._ahead_s = 0.0
        """Our clock less the gateway's, s."""
        self._airtimes: deque[tuple[float, float]] = deque(maxlen=256)
        self._started_at_unix_s: float | None = None

    @property
    def has_documents(self) -> bool:
        """Whether it has published enough."""
        return "link" in self._documents and "streams" in self._documents

    def take(self, name: str, document: Any, now_s: float) -> None:  # noqa: ANN401 (of any kind)
        """Store a document."""
        kind, _, rest = name.partition("/")
        is_new = name not in self._documents
        if is_new and kind in NAMED_DOCUMENTS and rest and len(self._named(kind)) >= MOST_NAMED:
            return  # anybody can put keys, and no gateway has so many
        self._documents[name] = document
        if name == "clock":
            self._ahead_s = now_s - document.now_unix_s
        if name == "node" and document.started_at_unix_s != self._started_at_unix_s:
            self._started_at_unix_s = document.started_at_unix_s
            self._airtimes.clear()  # it was restarted: counters begin at 0
            self._forget_named()
        if name == "link":
            self._airtimes.append((now_s, document.airtime_s))
            while len(self._airtimes) > 2 and self._airtimes[1][0] < now_s - WINDOW_S:
                self._airtimes.popleft()

    def _forget_named(self) -> None:
        """Forget links, routes and lists of links, which another file may lack."""
        for name in ("relay", "carry", *(f"{kind}/{each}" for kind in NAMED_DOCUMENTS
                                for each in self._named(kind))):  # fmt: skip
            self._documents.pop(name, None)

    def _named(self, kind: str) -> dict[str, Any]:
        """Return the documents of a kind by name, in the order of the names."""
        found = {
            name.partition("/")[2]: document
            for name, document in self._documents.items()
            if name.startswith(f"{kind}/")
        }
        return dict(sorted(found.items()))

    def note_alive(self, is_there: bool, now_s: float) -> None:
        """Note whether its session is on the network."""
        self._is_there = is_there
        self._note_gone(now_s)

    def note_answer(self, answers: bool, now_s: float) -> None:
        """Note whether it has answered that it runs."""
        self._answers = answers
        self._note_gone(now_s)

    def _note_gone(self, now_s: float) -> None:
        if self._is_there and self._answers:
            self._gone_at_s = None
        elif self._gone_at_s is None:
            self._gone_at_s = now_s

    def view(self, unix_s: float) -> GatewayView:
        """Return the present view."""
        there_s = unix_s - self._ahead_s
        node, link = self._get("node", NodeDocument), self._get("link", LinkDocument)
        streams, modem = self._get("streams", StreamsDocument), self._get("modem", ModemDocument)
        dropped, journal = (
            self._get("dropped", DroppedDocument),
            self._get("journal", JournalDocument),
        )
        channel = self._get("channel", ChannelDocument)
        utilisation, window_s = self._utilisation(link, node, unix_s, there_s)
        links, bonds = self._links(link, there_s), self._bonds()
        capabilities = link.capabilities
        return GatewayView(
            unix_s=round(unix_s, 3),
            address=self.address,
            name=node.name,
            is_alive=self._gone_at_s is None,
            gone_s=_ago(self._gone_at_s, unix_s),
            version=node.version,
            uptime_s=_ago(node.started_at_unix_s, there_s),
            wire=node.wire,
            link=node.link,
            link_state=link.state,
            link_detail=link.detail,
            links=links,
            routes=self._routes(),
            hops=self._hops(),
            bonds=bonds,
            carry=self._carry(there_s),
            is_silent=link.silent,
            why_silent=link.why_silent,
            mtu_bytes=capabilities.mtu_bytes if capabilities else None,
            bit_rate_bps=capabilities.bit_rate_bps if capabilities else None,
            battery_v=modem.battery_v,
            firmware=modem.firmware,
            journal=journal.failure or ("kept" if journal.kept else "none"),
            journal_doubt=journal.doubt,
            is_shared=node.shared,
            digest=streams.digest,
            frames_sent=link.frames_transmitted,
            frames_heard=link.frames_received,
            frames_damaged=sum(dropped.channel.get(reason, 0) for reason in _DAMAGED),
            bytes_sent=link.bytes_transmitted,
            airtime_s=round(link.airtime_s, 3),
            utilisation=utilisation,
            window_s=round(window_s, 1),
            waiting=sum(row.waiting for row in streams.streams),
            waits=self._waits(link, there_s),
            streams=tuple(self._stream(row, streams, dropped, there_s) for row in streams.streams),
            peers=self._peers(links, bonds, there_s),
            causes=self._causes(),
            transfers=self._transfers(),
            transmitting=_frame(channel.transmitting, there_s) if channel.transmitting else None,
            frames=tuple(_frame(row, there_s) for row in reversed(channel.last)),
            dropped=dropped.channel,
            events=self._events(there_s),
        )

    def _get(self, name: str, kind: type[T]) -> T:
        document = self._documents.get(name)
        return document if isinstance(document, kind) else kind()

    def _utilisation(
        self, link: LinkDocument, node: NodeDocument, unix_s: float, there_s: float
    ) -> tuple[float | None, float]:
        """Return the share of the time on the air, and the observed time, s.

        It covers the window, as far as it was observed; otherwise the time since the gateway runs.
        """
        if self._airtimes and unix_s - self._airtimes[0][0] >= WINDOW_S:
            # Airtime before the window is included in the first of the two.
            before = [used_s for at_s, used_s in self._airtimes if at_s <= unix_s - WINDOW_S]
            window_s, used_s = WINDOW_S, link.airtime_s - before[-1]
        else:
            uptime_s = _ago(node.started_at_unix_s, there_s)
            if not uptime_s:
                return None, 0.0
            window_s, used_s = uptime_s, link.airtime_s
        return round(min(max(used_s / window_s, 0.0), 1.0), 4), window_s

    def _stream(
        self, row: StreamRow, streams: StreamsDocument, dropped: DroppedDocument, there_s: float
    ) -> StreamView:
        ledger = self._get("ledger", LedgerDocument)
        own = sum(entry.bytes for entry in ledger.entries if entry.id == row.id)
        own_s = sum(entry.airtime_s for entry in ledger.entries if entry.id == row.id)
        total_s = sum(entry.airtime_s for entry in ledger.entries)
        heard_ago_s = _ago(row.heard_at_unix_s, there_s)
        is_aged = heard_ago_s is not None and row.age_s is not None
        useless = (dropped.expired, dropped.superseded, dropped.unsubscribed)
        return StreamView(
            id=row.id,
            name=row.name,
            kind=row.kind,
            jobs=tuple(row.jobs),
            published=row.published,
            sent=row.transmitted,
            heard=row.received,
            sent_ago_s=_ago(row.sent_at_unix_s, there_s),
            heard_ago_s=heard_ago_s,
            sent_rate_hz=_rate(row.sent_at_unix_s, row.sent_period_s, there_s),
            heard_rate_hz=_rate(row.heard_at_unix_s, row.heard_period_s, there_s),
            age_s=round((heard_ago_s or 0) + (row.age_s or 0), 3) if is_aged else None,
            waiting=row.waiting,
            delivering=row.delivering,
            outcomes=_outcomes(row),
            useless=sum(counts.get(row.name, 0) for counts in useless),
            expired=dropped.expired.get(row.name, 0) if row.delivering is None else row.expired,
            refused=row.refused + sum(dropped.local.get(row.name, {}).values()),
            deadline_missed=row.deadline_missed,
            airtime_bytes=own,
            airtime_share=round(own_s / total_s, 4) if total_s else 0.0,
            differs_at=tuple(each for d in streams.differ if d.id == row.id for each in d.peers),
        )

    def _waits(self, link: LinkDocument, there_s: float) -> WaitsView | None:
        """Return why the next frame of a link waits, unless that is over, or the gateway gone."""
        waits = link.waits
        if waits is None or self._gone_at_s is not None:
            return None
        if waits.until_unix_s is None:
            return WaitsView(why=waits.why, left_s=None)
        left_s = waits.until_unix_s - there_s
        if left_s < -_OVERDUE_S:
            return None
        return WaitsView(why=waits.why, left_s=round(max(0.0, left_s), 1))

    def _links(self, only: LinkDocument, there_s: float) -> tuple[LinkView, ...]:
        """Return each of several links, or the only one."""
        named: dict[str, LinkDocument] = self._named("link") or {only.name: only}
        return tuple(
            LinkView(
                name=name,
                state=link.state,
                detail=link.detail,
                frames_sent=link.frames_transmitted,
                frames_heard=link.frames_received,
                airtime_s=round(link.airtime_s, 3),
                paid=link.paid,
                waits=self._waits(link, there_s),
            )
            for name, link in named.items()
        )

    def _routes(self) -> tuple[RouteView, ...]:
        named: dict[str, RouteDocument] = self._named("route")
        return tuple(
            RouteView(
                name=name,
                path=tuple(route.path),
                link=route.link,
                link_state=route.link_state,
                frames_sent=route.frames_transmitted,
                frames_heard=route.frames_received,
            )
            for name, route in named.items()
        )

    def _hops(self) -> tuple[HopView, ...]:
        return tuple(
            HopView(
                route=hop.route,
                next_node=hop.next_node,
                waiting=hop.waiting,
                transmissions=hop.transmissions,
                passed_on=hop.passed_on,
                given_up=hop.given_up,
            )
            for hop in self._get("relay", RelayDocument).hops[:MOST_NAMED]
        )

    def _carry(self, there_s: float) -> CarryView | None:
        if "carry" not in self._documents:
            return None
        kept = self._get("carry", CarryDocument)
        return CarryView(
            own=kept.own,
            in_custody=kept.in_custody,
            carried=kept.carried,
            carried_bytes=kept.carried_bytes,
            max_bytes=kept.max_bytes,
            refused=kept.refused,
            expired=kept.expired,
            streams=tuple(_carried(row, there_s) for row in kept.streams[:MOST_NAMED]),
        )

    def _bonds(self) -> tuple[BondView, ...]:
        named: dict[str, BondDocument] = self._named("bond")
        return tuple(
            BondView(
                name=name,
                links=tuple(bond.links),
                in_use=bond.in_use,
                reach=dict(sorted(bond.reach.items())),
                again=bond.again,
                frames_sent=bond.frames_transmitted,
                frames_heard=bond.frames_received,
            )
            for name, bond in named.items()
        )

    def _peers(
        self, links: tuple[LinkView, ...], bonds: tuple[BondView, ...], there_s: float
    ) -> tuple[PeerView, ...]:
        rows: dict[int, PeerRow] = self._documents.get("peers", {})
        return tuple(
            self._peer(address, row, _link_to(address, links, bonds), there_s)
            for address, row in sorted(rows.items())
        )

    def _peer(self, address: int, row: PeerRow, link: str | None, there_s: float) -> PeerView:
        measured = self._get(f"peer/{address}/range", RangeDocument)
        metrics = row.metrics
        return PeerView(
            address=address,
            name=row.name,
            heard_ago_s=_ago(row.heard_at_unix_s, there_s),
            is_lost=self._get(f"peer/{address}/lost", LostDocument).lost,
            same_table=row.same_table,
            is_shared=row.shared,
            snr_db=metrics.snr_db if metrics else None,
            received_level_db=metrics.received_level_db if metrics else None,
            integrity=metrics.integrity if metrics else None,
            range_m=measured.range_m,
            propagation_s=measured.propagation_s,
            range_ago_s=_ago(measured.measured_at_unix_s, there_s),
            per=row.per,
            exchanges=row.delivered + row.not_delivered,
            late=tuple(self._get(f"peer/{address}/late", LateDocument).late),
            link=link,
            received=_received(row),
        )

    def _causes(self) -> tuple[CauseView, ...]:
        by_cause: dict[str, tuple[int, float]] = {}
        for entry in self._get("ledger", LedgerDocument).entries:
            size_bytes, airtime_s = by_cause.get(entry.cause, (0, 0.0))
            by_cause[entry.cause] = size_bytes + entry.bytes, airtime_s + entry.airtime_s
        total_s = sum(airtime_s for _, airtime_s in by_cause.values())
        return tuple(
            CauseView(
                cause=cause,
                airtime_bytes=size_bytes,
                airtime_s=round(airtime_s, 3),
                share=round(airtime_s / total_s, 4) if total_s else 0.0,
            )
            for cause, (size_bytes, airtime_s) in sorted(
                by_cause.items(), key=lambda item: (-item[1][0], item[0])
            )
        )

    def _transfers(self) -> tuple[TransferView, ...]:
        objects = self._get("objects", ObjectsDocument)
        rows = [*objects.sending, *objects.receiving, *reversed(objects.ended)]
        return tuple(_transfer(row) for row in rows)

    def _events(self, there_s: float) -> tuple[EventView, ...]:
        return tuple(
            EventView(
                ago_s=_ago(row.at_unix_s, there_s) or 0.0,
                event=row.event,
                is_trouble=row.trouble,
                text=row.text,
            )
            for row in reversed(self._get("events", EventsDocument).events)
        )


def _frame(row: FrameRow, there_s: float) -> FrameView:
    return FrameView(
        ago_s=_ago(row.begun_unix_s, there_s) or 0.0,
        way=row.way,
        peer=row.peer,
        size_bytes=row.bytes,
        airtime_s=round(row.airtime_s, 3),
        streams=tuple(row.streams),
        outcome=row.outcome,
    )


def _carried(row: CarriedRow, there_s: float) -> CarriedView:
    ends_at_s = row.ends_at_unix_s
    return CarriedView(
        stream=row.stream,
        own=row.own,
        custodians=row.custodians,
        carried=row.carried,
        carried_bytes=row.carried_bytes,
        oldest_s=_ago(row.oldest_at_unix_s, there_s),
        ends_in_s=None if ends_at_s is None else round(max(ends_at_s - there_s, 0.0), 3),
    )


def _link_to(address: int, links: tuple[LinkView, ...], bonds: tuple[BondView, ...]) -> str | None:
    """Return the link by which the first list of links that knows reaches a node."""
    found = (first_link(bond, address, links)[0] for bond in bonds)
    return next((each for each in found if each is not None), None)


def _received(row: PeerRow) -> tuple[ReceivedView, ...] | None:
    if row.received is None:
        return None
    return tuple(
        ReceivedView(link=link, frames=each.frames, airtime_s=each.airtime_s)
        for link, each in sorted(row.received.items())
    )


def _outcomes(row: StreamRow) -> dict[str, int]:
    if row.delivering is None:
        return {}
    return {outcome.value: getattr(row, outcome.value) for outcome in DeliveryOutcome}


def _transfer(row: TransferRow) -> TransferView:
    comes = row.source is not None
    return TransferView(
        stream=row.stream or "",
        direction="from" if comes else "to",
        peer=row.source if comes else row.to,
        done_bytes=row.done_bytes,
        sent_bytes=None if comes else row.sent_bytes,
        total_bytes=row.total_bytes,
        outcome=row.outcome,
    )


def _ago(at_unix_s: float | None, now_s: float) -> float | None:
    return None if at_unix_s is None else round(max(now_s - at_unix_s, 0.0), 3)


def _rate(at_unix_s: float | None, period_s: float | None, now_s: float) -> float | None:
    """Return the present rate, 1/s: that of a stopped stream falls."""
    ago_s = _ago(at_unix_s, now_s)
    if ago_s is None or period_s is None:
        return None
    return round(1 / max(period_s, ago_s, _LEAST_PERIOD_S), 6)
