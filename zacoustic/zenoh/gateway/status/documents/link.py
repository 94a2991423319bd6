"""Documents about the node, its link, its journal, and the bytes by stream and cause."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.base.stats import EngineStats
from zacoustic.core.bond.bonding import BondStatus
from zacoustic.core.bond.spec import Tariff
from zacoustic.core.engine.engine import Engine
from zacoustic.core.relay.paths import PathState
from zacoustic.core.relay.route import Route
from zacoustic.core.transport.carry.status import CarriedSums, CarryStatus, CarrySums
from zacoustic.run.runner import LinkRunner
from zacoustic.status.link import (
    BondDocument,
    CarriedRow,
    CarryDocument,
    ChangedPath,
    LedgerDocument,
    LedgerRow,
    LinkDocument,
    RelayDocument,
    RouteDocument,
    WaitsDocument,
    crossed,
)
from zacoustic.status.node import JournalDocument, NodeDocument, SealDocument
from zacoustic.zenoh.gateway.status.dates import Dates


class LinkStatus:
    """The documents ``node``, ``link``, ``ledger`` and ``journal`` of one gateway.

    Args:
        runner: Runs the engine and the link.
        about: Constant facts.
        has_journal: The journal outlives the process.
        clock: Source of the engine's instants.
        dates: Dates of the documents.
        seal: Returns public facts of the key and the life; None: frames are not sealed.
        tariffs: The prices of links that cost money, by their names.
    """

    def __init__(
        self,
        runner: LinkRunner,
        about: NodeDocument,
        *,
        has_journal: bool,
        clock: Clock,
        dates: Dates,
        seal: Callable[[], SealDocument] | None = None,
        tariffs: Mapping[str, Tariff] = MappingProxyType({}),
    ) -> None:
        self._tariffs = tariffs
        self._seal = seal
        self._runner = runner
        self._about = about
        self._has_journal = has_journal
        self._clock = clock
        self._dates = dates

    def documents(self) -> dict[str, object]:
        """Return the documents, by the end of their keys."""
        engine = self._engine
        doubt = engine.doubt.reason
        return {
            "node": msgspec.structs.replace(
                self._about, doubt=doubt, is_shared=engine.address in engine.twins.shared
            ),
            **self._links(),
            "ledger": self._ledger(engine.stats),
            **self._seals(),
            "journal": JournalDocument(
                kept=self._has_journal, failure=engine.journal_failure, doubt=doubt
            ),
        }

    @property
    def _engine(self) -> Engine:
        return self._runner.engine

    def _seals(self) -> dict[str, object]:
        if self._seal is None:
            return {}
        known = self._seal()
        failure = known.failure or self._engine.seal_failure
        return {"seal": msgspec.structs.replace(known, failure=failure)}

    def _links(self) -> dict[str, object]:
        """Return the document of the first link, and with several links one for each.

        The counters of the first cover all links, like the ledger.
        """
        engine = self._engine
        names, whole = engine.links, engine.stats
        found: dict[str, object] = {"link": self._link(names[0], whole)}
        if len(names) > 1:
            found |= {
                f"link/{name}": self._link(name, whole.links[name], self._ledger(whole.links[name]))
                for name in names
            }
        if engine.hops:
            changed = {name: _changed(each) for name, each in engine.changed_paths.items()}
            found["relay"] = RelayDocument(hops=engine.hops, changed=changed or UNSET)
        if engine.carry is not None:
            found["carry"] = self._carry(engine.carry)
        found |= {f"route/{each.name}": self._route(each) for each in engine.routes}
        return found | {f"bond/{each.name}": self._bond(each) for each in engine.bonds}

    def _carry(self, kept: CarryStatus) -> CarryDocument:
        """Return the document of what is kept of carried topics, with dates instead of instants."""
        table = self._engine.table
        rows = tuple(
            CarriedRow(
                id=each.stream_id,
                stream=table.by_id(each.stream_id).name,
                oldest_at_unix_s=self._date(each.oldest_at),
                ends_at_unix_s=self._date(each.ends_at),
                **_of(CarriedSums, each),
            )
            for each in kept.streams
        )
        return CarryDocument(streams=rows, **_of(CarrySums, kept))

    def _date(self, instant: int | None) -> float | None:
        return None if instant is None else self._dates.of(instant)

    def _bond(self, bond: BondStatus) -> BondDocument:
        stats = self._engine.stats.links[bond.name]
        return BondDocument(ledger=self._ledger(stats), **_of(BondStatus, bond), **crossed(stats))

    def _route(self, route: Route) -> RouteDocument:
        stats = self._engine.stats.links[route.name]
        changed = self._engine.changed_paths.get(route.name)
        return RouteDocument(
            name=route.name,
            path=route.path if changed is None else changed.path,
            link=route.link,
            link_state=self._engine.state_of(route.name).value,
            capabilities=self._engine.capabilities_of(route.name),
            ledger=self._ledger(stats),
            **crossed(stats),
        )

    def _link(
        self, name: str, stats: EngineStats, ledger: LedgerDocument | UnsetType = UNSET
    ) -> LinkDocument:
        side, why_silent = self._runner.side(name), self._why_silent()
        access, tariff = self._engine.access_state(name), self._tariffs.get(name)
        paid_bytes = self._engine.stats.links[name].paid_bytes
        return LinkDocument(
            name=name,
            state=side.state.value,
            detail=side.detail,
            is_silent=bool(why_silent),
            why_silent=why_silent,
            waits=self._waits(name),
            access=UNSET if access is None else access,
            capabilities=self._engine.capabilities_of(name),
            diagnostics=side.link.diagnostics(),
            airtime_s=ns_to_seconds(stats.airtime_ns),
            reports=dict(stats.reports),
            paid_bytes=UNSET if tariff is None else paid_bytes,
            paid=UNSET if tariff is None else round(paid_bytes * tariff.per_byte, 4),
            ledger=ledger,
            **crossed(stats),
        )

    def _waits(self, name: str) -> WaitsDocument | None:
        """Return why the next frame of a link waits, and until when; None: nothing waits."""
        waits = self._engine.waits(self._clock(), name)
        if waits is None:
            return None
        return WaitsDocument(why=waits.why.value, until_unix_s=self._date(waits.until))

    def _why_silent(self) -> str:
        """Return why nothing is transmitted; empty: no command does it, and the time is known."""
        engine = self._engine
        state = engine.silence.state(self._clock())
        if state.is_commanded:
            return f"commanded; {state.doubt}" if state.doubt else "commanded"
        quiet = "a quiet window" if state.is_silent else ""
        return engine.seal_failure or engine.clock.doubt or quiet

    def _ledger(self, stats: EngineStats) -> LedgerDocument:
        return LedgerDocument(
            bytes=stats.bytes_transmitted,
            airtime_s=ns_to_seconds(stats.airtime_ns),
            entries=[LedgerRow.of(each, self._name(each.stream_id)) for each in stats.ledger()],
        )

    def _name(self, stream_id: int) -> str:
        stream = self._engine.table.get(stream_id)
        return stream.name if stream is not None else ""


def _changed(state: PathState) -> ChangedPath:
    return ChangedPath(revision=state.revision, number=state.number, path=state.path)


def _of(kind: type[msgspec.Struct], figures: msgspec.Struct) -> dict[str, Any]:
    """Return the members that a struct has of one of its bases, to make another child of that."""
    return {name: getattr(figures, name) for name in kind.__struct_fields__}
