"""The board: the newest documents of all gateways, and the values derived from them.

Instants in documents are by the clock of the gateway's computer, which may differ from ours by
hours: a vehicle has no network time. So a gateway's answers contain its own time, and ages are
computed by its clock.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final, TypeVar

import msgspec
from msgspec import UNSET, UnsetType

from zacoustic.app.tools.watch.views import (
    CarriedView,
    CarryView,
    CauseView,
    EventView,
    FrameView,
    GatewayView,
    LinkView,
    PeerView,
    ReceivedView,
    StreamView,
    TransferView,
    WaitsView,
)
from zacoustic.app.tools.watch.ways import first_link
from zacoustic.core.base.linktypes import LinkMetrics
from zacoustic.core.engine.events import DeliveryOutcome
from zacoustic.status.channel import ChannelDocument, FrameRow, ObjectsDocument, TransferRow
from zacoustic.status.link import (
    BondDocument,
    CarriedRow,
    CarryDocument,
    LedgerDocument,
    LinkDocument,
    RelayDocument,
)
from zacoustic.status.node import (
    DroppedDocument,
    EventsDocument,
    JournalDocument,
    ModemDocument,
    NodeDocument,
)
from zacoustic.status.peers import LateDocument, LostDocument, PeerRow, RangeDocument
from zacoustic.status.streams import StreamRow, StreamsDocument
from zacoustic.status.table import ADDRESS, NAMED, kind_of
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


T = TypeVar("T")
V = TypeVar("V", bound=msgspec.Struct)


def addresses_in(key: str) -> list[int]:
    """Return the address of the gateway whose document has this key; empty: none."""
    prefix, _, rest = key.partition("/")
    address = rest.partition("/")[0]
    return [int(address)] if prefix == PREFIX and ADDRESS.fullmatch(address) else []


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
        kind = kind_of("/".join(chunks[2:]))
        if kind is None:
            return
        try:
            document = msgspec.json.decode(payload, type=kind)
        except (msgspec.MsgspecError, RecursionError):  # anybody can put a key
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
        if is_new and kind in NAMED and rest and len(self._named(kind)) >= MOST_NAMED:
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
        for name in ("relay", "carry", *(f"{kind}/{each}" for kind in NAMED
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
        return _more(
            GatewayView,
            node,
            unix_s=round(unix_s, 3),
            address=self.address,
            is_alive=self._gone_at_s is None,
            gone_s=_ago(self._gone_at_s, unix_s),
            uptime_s=_ago(node.started_at_unix_s, there_s),
            doubt=journal.doubt or node.doubt,
            whole=self._link(link, there_s),
            modem=modem,
            links=links,
            routes=tuple(
                msgspec.structs.replace(route, name=name)
                for name, route in self._named("route").items()
            ),
            hops=tuple(self._get("relay", RelayDocument).hops[:MOST_NAMED]),
            bonds=bonds,
            carry=self._carry(there_s),
            journal=journal.failure or ("kept" if journal.kept else "none"),
            digest=streams.digest,
            frames_damaged=sum(dropped.channel.get(reason, 0) for reason in _DAMAGED),
            utilisation=utilisation,
            window_s=round(window_s, 1),
            waiting=sum(row.waiting for row in streams.streams),
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
        return _more(
            StreamView,
            row,
            sent_ago_s=_ago(row.sent_at_unix_s, there_s),
            heard_ago_s=heard_ago_s,
            sent_rate_hz=_rate(row.sent_at_unix_s, row.sent_period_s, there_s),
            heard_rate_hz=_rate(row.heard_at_unix_s, row.heard_period_s, there_s),
            age_s=round((heard_ago_s or 0) + (row.age_s or 0), 3) if is_aged else None,
            outcomes=_outcomes(row),
            useless=sum(counts.get(row.name, 0) for counts in useless),
            expired=dropped.expired.get(row.name, 0) if row.expired is UNSET else row.expired,
            refused=(row.refused or 0) + sum(dropped.local.get(row.name, {}).values()),
            airtime_bytes=own,
            airtime_share=round(own_s / total_s, 4) if total_s else 0.0,
            differs_at=tuple(each for d in streams.differ if d.id == row.id for each in d.peers),
        )

    def _waits(self, link: LinkDocument, there_s: float) -> WaitsView | None:
        """Return why the next frame of a link waits, unless that is over, or the gateway gone."""
        waits = link.waits
        if waits is None or self._gone_at_s is not None:
            return None
        until_s = waits.until_unix_s
        left_s = None if until_s is None else until_s - there_s
        if left_s is not None and left_s < -_OVERDUE_S:
            return None
        return _more(
            WaitsView, waits, left_s=None if left_s is None else round(max(0.0, left_s), 1)
        )

    def _links(self, only: LinkDocument, there_s: float) -> tuple[LinkView, ...]:
        """Return each of several links, or the only one."""
        named: dict[str, LinkDocument] = self._named("link") or {only.name: only}
        return tuple(
            self._link(msgspec.structs.replace(link, name=name), there_s)
            for name, link in named.items()
        )

    def _link(self, link: LinkDocument, there_s: float) -> LinkView:
        return _more(
            LinkView,
            link,
            airtime_s=round(link.airtime_s, 3),
            waits=self._waits(link, there_s),
            ledger=UNSET,  # the gateway's has all of it
        )

    def _carry(self, there_s: float) -> CarryView | None:
        if "carry" not in self._documents:
            return None
        kept = self._get("carry", CarryDocument)
        rows = tuple(_carried(row, there_s) for row in kept.streams[:MOST_NAMED])
        return _more(CarryView, kept, streams=rows)

    def _bonds(self) -> tuple[BondDocument, ...]:
        return tuple(
            msgspec.structs.replace(bond, name=name, reach=dict(sorted(bond.reach.items())))
            for name, bond in self._named("bond").items()
        )

    def _peers(
        self, links: tuple[LinkView, ...], bonds: tuple[BondDocument, ...], there_s: float
    ) -> tuple[PeerView, ...]:
        rows: dict[int, PeerRow] = self._documents.get("peers", {})
        return tuple(
            self._peer(address, row, _link_to(address, links, bonds), there_s)
            for address, row in sorted(rows.items())
        )

    def _peer(self, address: int, row: PeerRow, link: str | None, there_s: float) -> PeerView:
        measured = self._get(f"peer/{address}/range", RangeDocument)
        metrics = row.metrics or LinkMetrics()
        return _more(
            PeerView,
            row,
            address=address,
            heard_ago_s=_ago(row.heard_at_unix_s, there_s),
            is_lost=self._get(f"peer/{address}/lost", LostDocument).lost,
            snr_db=metrics.snr_db,
            received_level_db=metrics.received_level_db,
            integrity=metrics.integrity,
            range_m=measured.range_m,
            propagation_s=measured.propagation_s,
            range_ago_s=_ago(measured.measured_at_unix_s, there_s),
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
            _more(EventView, row, ago_s=_ago(row.at_unix_s, there_s) or 0.0)
            for row in reversed(self._get("events", EventsDocument).events)
        )


def _frame(row: FrameRow, there_s: float) -> FrameView:
    ago_s = _ago(row.begun_unix_s, there_s) or 0.0
    return _more(FrameView, row, ago_s=ago_s, airtime_s=round(row.airtime_s, 3))


def _carried(row: CarriedRow, there_s: float) -> CarriedView:
    ends_at_s = row.ends_at_unix_s
    return _more(
        CarriedView,
        row,
        oldest_s=_ago(row.oldest_at_unix_s, there_s),
        ends_in_s=None if ends_at_s is None else round(max(ends_at_s - there_s, 0.0), 3),
    )


def _link_to(
    address: int, links: tuple[LinkView, ...], bonds: tuple[BondDocument, ...]
) -> str | None:
    """Return the link by which the first list of links that knows reaches a node."""
    found = (first_link(bond, address, links)[0] for bond in bonds)
    return next((each for each in found if each is not None), None)


def _received(row: PeerRow) -> tuple[ReceivedView, ...] | None:
    if row.received is None:
        return None
    return tuple(
        _more(ReceivedView, each, link=link) for link, each in sorted(row.received.items())
    )


def _outcomes(row: StreamRow) -> dict[str, int]:
    if row.delivering is UNSET:
        return {}
    return {outcome.value: getattr(row, outcome.value) or 0 for outcome in DeliveryOutcome}


def _transfer(row: TransferRow) -> TransferView:
    return _more(
        TransferView,
        row,
        stream=row.stream or "",
        direction="to" if row.source is UNSET else "from",
        peer=_known(row.to if row.source is UNSET else row.source),
        sent_bytes=_known(row.sent_bytes),
        outcome=_known(row.outcome),
    )


def _known(figure: T | UnsetType | None) -> T | None:
    return None if figure is UNSET else figure


def _more(kind: type[V], row: msgspec.Struct, **added: object) -> V:
    """Return a view of a document: its members, and those that are added."""
    return kind(**{**msgspec.structs.asdict(row), **added})


def _ago(at_unix_s: float | None, now_s: float) -> float | None:
    return None if at_unix_s is None else round(max(now_s - at_unix_s, 0.0), 3)


def _rate(at_unix_s: float | None, period_s: float | None, now_s: float) -> float | None:
    """Return the present rate, 1/s: that of a stopped stream falls."""
    ago_s = _ago(at_unix_s, now_s)
    if ago_s is None or period_s is None:
        return None
    return round(1 / max(period_s, ago_s, _LEAST_PERIOD_S), 6)
