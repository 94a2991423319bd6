"""The document about the nodes heard."""

from collections.abc import Mapping

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.linktypes import Service
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import PeerSeen
from zacoustic.run.runner import LinkRunner
from zacoustic.status.peers import PeerRow, ReceivedRow
from zacoustic.zenoh.gateway.status.traffic import Traffic


class PeerTable:
    """The document ``peers`` of one gateway.

    Args:
        runner: Runs the engine that hears them.
        traffic: Knows when each was heard, and the outcomes of frames to it.
    """

    def __init__(self, runner: LinkRunner, traffic: Traffic) -> None:
        self._runner = runner
        self._traffic = traffic
        self._seen: dict[int, PeerSeen] = {}

    def note(self, event: PeerSeen) -> None:
        """Store a peer's introduction."""
        self._seen[event.address] = event

    def documents(self) -> dict[str, object]:
        """Return the document, by the end of its key."""
        return {"peers": self._peers()}

    @property
    def _engine(self) -> Engine:
        return self._runner.engine

    def _peers(self) -> dict[int, PeerRow]:
        confirmed = self._engine.peers()
        measured = self._engine.measurements.addresses()
        heard_at_unix_s = self._traffic.heard_at_unix_s()
        addresses = sorted({*confirmed, *self._seen, *heard_at_unix_s, *measured})
        return {
            address: self._peer(address, confirmed, heard_at_unix_s.get(address))
            for address in addresses
        }

    def _peer(
        self, address: int, confirmed: dict[int, bool], heard_at_unix_s: float | None
    ) -> PeerRow:
        seen = self._seen.get(address)
        round_trip_ns = self._engine.stats.round_trips_ns.get(address)
        return PeerRow(
            name=self._engine.table.nodes.get(address, ""),
            epoch=seen.epoch if seen else None,
            same_table=seen.same_table if seen else None,
            wire_version=seen.wire_version if seen else None,
            is_shared=address in self._engine.twins.shared,
            confirmed_us=confirmed.get(address, False),
            heard_at_unix_s=heard_at_unix_s,
            received=self._received(address),
            round_trip_s=ns_to_seconds(round_trip_ns) if round_trip_ns else None,
            metrics=self._engine.measurements.metrics(address),
            **self._traffic.of_peer(address),
        )

    def _received(self, address: int) -> dict[str, ReceivedRow]:
        """Return what came from a node by each link; without relays, for those are other nodes."""
        by_link = self._traffic.received_from(address)
        return {
            link: ReceivedRow(
                frames=sum(frames for frames, _ in by_link[link].values()),
                bytes=sum(size_bytes for _, size_bytes in by_link[link].values()),
                airtime_s=self._airtime_s(link, by_link[link]),
            )
            for link in self._engine.links
            if link in by_link
        }

    def _airtime_s(self, link: str, counts: Mapping[Service, tuple[int, int]]) -> float | None:
        """Return the airtime of frames by the bit rates of their link, s; None: unknown yet."""
        capabilities = self._engine.capabilities_of(link)
        if capabilities is None:
            return None
        airtime_ns = 0
        for service, (frames, size_bytes) in counts.items():
            none_ns = capabilities.airtime_ns(0, service)
            airtime_ns += capabilities.airtime_ns(size_bytes, service) + (frames - 1) * none_ns
        return round(ns_to_seconds(airtime_ns), 3)
