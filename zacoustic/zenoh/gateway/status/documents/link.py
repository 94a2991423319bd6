"""Documents about the node, its link, its journal, and the bytes by stream and cause."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import msgspec

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.base.stats import EngineStats, LedgerEntry
from zacoustic.core.bond.bonding import BondStatus
from zacoustic.core.bond.spec import Tariff
from zacoustic.core.engine.engine import Engine
from zacoustic.core.relay.route import Route
from zacoustic.core.transport.carry.status import CarryStatus
from zacoustic.run.runner import LinkRunner
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
        about: Mapping[str, object],
        *,
        has_journal: bool,
        clock: Clock,
        dates: Dates,
        seal: Callable[[], dict[str, object]] | None = None,
        tariffs: Mapping[str, Tariff] = MappingProxyType({}),
    ) -> None:
        self._tariffs = tariffs
        self._seal = seal
        self._runner = runner
        self._about = dict(about)
        self._has_journal = has_journal
        self._clock = clock
        self._dates = dates

    def documents(self) -> dict[str, object]:
        """Return the documents, by the end of their keys."""
        doubt = self._engine.doubt.reason
        return {
            "node": self._about
            | {"doubt": doubt, "shared": self._engine.address in self._engine.twins.shared},
            **self._links(),
            "ledger": self._ledger(self._engine.stats),
            **self._seals(),
            "journal": {
                "kept": self._has_journal,
                "failure": self._engine.journal_failure,
                "doubt": doubt,
            },
        }

    @property
    def _engine(self) -> Engine:
        return self._runner.engine

    def _seals(self) -> dict[str, object]:
        if self._seal is None:
            return {}
        known, failure = self._seal(), self._engine.seal_failure
        return {"seal": known | {"failure": known["failure"] or failure}}

    def _links(self) -> dict[str, object]:
        """Return the document of the first link, and with several links one for each.

        The counters of the first cover all links, like the ledger.
        """
        names, whole = self._engine.links, self._engine.stats
        found: dict[str, object] = {"link": self._link(names[0], whole)}
        if len(names) > 1:
            found |= {
                f"link/{name}": self._link(name, whole.links[name])
                | {"ledger": self._ledger(whole.links[name])}
                for name in names
            }
        if self._engine.hops:
            found["relay"] = {"hops": msgspec.to_builtins(self._engine.hops), **self._changed()}
        if self._engine.carry is not None:
            found["carry"] = self._carry(self._engine.carry)
        found |= {f"route/{each.name}": self._route(each) for each in self._engine.routes}
        return found | {f"bond/{each.name}": self._bond(each) for each in self._engine.bonds}

    def _carry(self, kept: CarryStatus) -> dict[str, object]:
        """Return the document of what is kept of carried topics, with dates instead of instants."""
        rows = [
            {
                "id": each.stream_id,
                "stream": self._engine.table.by_id(each.stream_id).name,
                "own": _by_text(each.own),
                "custodians": _by_text(each.custodians),
                "carried": _by_text(each.carried),
                "carried_bytes": each.carried_bytes,
                "oldest_at_unix_s": self._date(each.oldest_at),
                "ends_at_unix_s": self._date(each.ends_at),
            }
            for each in kept.streams
        ]
        sums: dict[str, object] = msgspec.to_builtins(kept)
        return sums | {"streams": rows}

    def _date(self, instant: int | None) -> float | None:
        return None if instant is None else self._dates.of(instant)

    def _changed(self) -> dict[str, object]:
        """Return the routes whose path a command has changed, if there are any."""
        changed = {
            name: {"revision": each.revision, "number": each.number, "path": each.path}
            for name, each in self._engine.changed_paths.items()
        }
        return {"changed": changed} if changed else {}

    def _bond(self, bond: BondStatus) -> dict[str, object]:
        """Return the document of a list of links that is used as one."""
        stats = self._engine.stats.links[bond.name]
        return {
            "name": bond.name,
            "links": bond.links,
            "in_use": bond.in_use,
            "reach": {
                str(address): {link: reach.value for link, reach in by_link.items()}
                for address, by_link in bond.reach.items()
            },
            "again": bond.again,
            "frames_transmitted": stats.frames_transmitted,
            "bytes_transmitted": stats.bytes_transmitted,
            "frames_received": stats.frames_received,
            "bytes_received": stats.bytes_received,
            "ledger": self._ledger(stats),
        }

    def _route(self, route: Route) -> dict[str, object]:
        """Return the document of a route that ends here; nobody knows whether its relays live."""
        stats = self._engine.stats.links[route.name]
        changed = self._engine.changed_paths.get(route.name)
        return {
            "name": route.name,
            "path": route.path if changed is None else changed.path,
            "link": route.link,
            "link_state": self._engine.state_of(route.name).value,
            "capabilities": self._engine.capabilities_of(route.name),
            "frames_transmitted": stats.frames_transmitted,
            "bytes_transmitted": stats.bytes_transmitted,
            "frames_received": stats.frames_received,
            "bytes_received": stats.bytes_received,
            "ledger": self._ledger(stats),
        }

    def _link(self, name: str, stats: EngineStats) -> dict[str, object]:
        side, why_silent = self._runner.side(name), self._why_silent()
        return {
            "name": name,
            "state": side.state.value,
            "detail": side.detail,
            "silent": bool(why_silent),
            "why_silent": why_silent,
            "waits": self._waits(name),
            **self._access(name),
            "capabilities": self._engine.capabilities_of(name),
            "diagnostics": side.link.diagnostics(),
            "frames_transmitted": stats.frames_transmitted,
            "bytes_transmitted": stats.bytes_transmitted,
            "airtime_s": ns_to_seconds(stats.airtime_ns),
            "frames_received": stats.frames_received,
            "bytes_received": stats.bytes_received,
            "reports": stats.reports,
            **self._paid(name),
        }

    def _paid(self, name: str) -> dict[str, object]:
        """Return what was paid on a link with a tariff; nothing if it has none."""
        tariff = self._tariffs.get(name)
        if tariff is None:
            return {}
        paid_bytes = self._engine.stats.links[name].paid_bytes
        return {"paid_bytes": paid_bytes, "paid": round(paid_bytes * tariff.per_byte, 4)}

    def _access(self, name: str) -> dict[str, object]:
        """Return what the schedule of a link does; nothing if it has none."""
        state = self._engine.access_state(name)
        return {} if state is None else {"access": msgspec.to_builtins(state)}

    def _waits(self, name: str) -> dict[str, object] | None:
        """Return why the next frame of a link waits, and until when; None: nothing waits."""
        waits = self._engine.waits(self._clock(), name)
        if waits is None:
            return None
        return {"why": waits.why.value, "until_unix_s": self._date(waits.until)}

    def _why_silent(self) -> str:
        """Return why nothing is transmitted; empty: no command does it, and the time is known."""
        engine = self._engine
        state = engine.silence.state(self._clock())
        if state.is_commanded:
            return f"commanded; {state.doubt}" if state.doubt else "commanded"
        quiet = "a quiet window" if state.is_silent else ""
        return engine.seal_failure or engine.clock.doubt or quiet

    def _ledger(self, stats: EngineStats) -> dict[str, object]:
        return {
            "bytes": stats.bytes_transmitted,
            "airtime_s": ns_to_seconds(stats.airtime_ns),
            "entries": [self._entry(entry) for entry in stats.ledger()],
        }

    def _entry(self, entry: LedgerEntry) -> dict[str, object]:
        stream = self._engine.table.get(entry.stream_id)
        return {
            "id": entry.stream_id,
            "stream": stream.name if stream is not None else "",
            "cause": entry.cause.value,
            "bytes": entry.transmitted_bytes,
            "airtime_s": round(ns_to_seconds(entry.airtime_ns), 6),
        }


def _by_text(counts: Mapping[int, int]) -> dict[str, int]:
    """Return counts by address as JSON has them: its names are texts."""
    return {str(address): count for address, count in counts.items()}
