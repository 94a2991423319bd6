"""What a gateway publishes about itself: its health report, frames for observers, notices."""

from zacoustic.core.engine.events import PeerSeen, SampleReceived
from zacoustic.zenoh.gateway.status.documents.peers import PeerTable
from zacoustic.zenoh.gateway.status.documents.streams import StreamStatus
from zacoustic.zenoh.gateway.status.framefeed import FrameFeed
from zacoustic.zenoh.gateway.status.health import Health
from zacoustic.zenoh.gateway.status.recent_events import Announcer
from zacoustic.zenoh.gateway.status.report import Report
from zacoustic.zenoh.gateway.status.traffic import Traffic


class Status:
    """The status of one gateway; for the loop.

    Args:
        report: The health report.
        health: Puts it on the local network.
        feed: Puts frames while there are subscribers.
        traffic: Stores the ages of samples.
        peers: Stores introductions.
        streams: Stores outcomes, and streams that differ.
        announcer: Emits notices.
    """

    def __init__(
        self,
        report: Report,
        health: Health,
        feed: FrameFeed,
        *,
        traffic: Traffic,
        peers: PeerTable,
        streams: StreamStatus,
        announcer: Announcer,
    ) -> None:
        self.report = report
        self.health = health
        self.feed = feed
        self.tell = announcer.tell
        self.note_delivery = streams.note_delivery
        self.note_difference = streams.note_difference
        self._traffic = traffic
        self._peers = peers
        self._streams = streams
        self._announcer = announcer

    def note_sample(self, event: SampleReceived) -> None:
        """Store the age of a sample as it arrived."""
        self._traffic.note_age(event.stream_id, event.age_s)

    def note_peer(self, event: PeerSeen) -> None:
        """Store a peer's introduction."""
        self._peers.note(event)
        self._streams.note_peer(event)

    def close(self) -> None:
        """Put and emit nothing any more."""
        self._announcer.close()
        self.feed.close()
        self.health.close()
