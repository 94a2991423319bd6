"""The shore gateway's health of link and channel, kept for a while to see changes.

The documents are those under ``@acoustic/1/``: JSON, put when they have changed. Their instants are
those of the gateway's clock of people, which is in the same local network.
"""

import contextlib
import json
from collections import deque
from itertools import pairwise
from typing import Any, Final

import msgspec

from examples.auv.fates import Fates
from examples.auv.shore import SOUND_S
from examples.auv.start import VEHICLE

WINDOW_S: Final = 60.0
"""Window for airtime and speed of a photo, s."""
FRAMES_S: Final = 45.0
"""How long a frame is kept for the picture of the channel, s."""
_FRAMES_MOST: Final = 128
_SOON_S: Final = 0.5
"""Steps within this time are one, s: the packets of a train come together."""


class Frame(msgspec.Struct, frozen=True):
    """A frame that is or was lately on the channel."""

    way: str
    """``out`` or ``in``, seen from the shore."""
    bytes: int
    streams: list[str]
    begun_unix_s: float
    airtime_s: float
    outcome: str = ""

    @property
    def ended_unix_s(self) -> float:
        """When the modem had sent, or heard, all of it."""
        return self.begun_unix_s + self.airtime_s


class Waiting(msgspec.Struct, frozen=True):
    """Samples or calls of one stream that the shore's gateway has not got rid of."""

    stream: str
    queued: int
    """Wait for a frame."""
    unacknowledged: int
    """Not confirmed by the vehicle: waiting, under way, or lost and repeated later."""


class Arriving(msgspec.Struct, frozen=True):
    """A large sample on its way to the shore."""

    done_bytes: int
    total_bytes: int | None
    """None: not known yet."""
    left_s: float | None
    """How long it will still take, at the speed of the last minute; None: not known."""
    share: float | None
    """Which share of it has come, by that speed since the last step; None: its size is unknown."""


class LinkWatch:
    """Keeps the gateway's documents."""

    def __init__(self) -> None:
        self.documents: dict[str, Any] = {}
        """The newest of each, by the end of its key."""
        self.fates = Fates()
        self.answered_at_s: float | None = None
        """When the gateway has answered last; None: it was not asked."""
        self._ahead_s: float | None = None
        self.down_at_s: float | None = None
        """Since when the link is not up, as far as it was seen; None: it is."""
        self._airtimes: deque[tuple[float, float]] = deque(maxlen=256)
        self._frames: dict[tuple[str, float], Frame] = {}
        self._progress: dict[tuple[int, int], deque[tuple[float, int]]] = {}

    def answered(self, text: str, now_s: float) -> None:
        """The gateway runs, and has sent its time."""
        self.answered_at_s = now_s
        with contextlib.suppress(ValueError, LookupError, TypeError):
            self._ahead_s = float(json.loads(text)["now_unix_s"]) - now_s

    def unix_s(self, now_s: float) -> float | None:
        """Return the gateway's clock of people, by which its documents are dated; None: unknown."""
        return None if self._ahead_s is None else now_s + self._ahead_s

    def take(self, name: str, document: dict[str, Any], now_s: float) -> None:
        """Take a document.

        Args:
            name: The end of its key.
            document: Its contents.
            now_s: The instant.
        """
        self.documents[name] = document
        match name:
            case "streams":
                self.fates.take(document)
            case "link":
                if document["state"] == "up":
                    self.down_at_s = None
                elif self.down_at_s is None:
                    self.down_at_s = now_s
                self._airtimes.append((now_s, document["airtime_s"]))
            case "channel":
                self._take_frames(document)
            case "objects":
                self._take_progress(document, now_s)
            case _:
                pass

    # The link

    @property
    def metrics(self) -> dict[str, float | None]:
        """What the modem has measured of the vehicle's, newest of each."""
        found: dict[str, float | None] = self._peer.get("metrics") or {}
        return found

    @property
    def heard_at_unix_s(self) -> float | None:
        """When the vehicle's modem was heard last."""
        found: float | None = self._peer.get("heard_at_unix_s")
        return found

    @property
    def loss(self) -> float | None:
        """Which share of the frames to the vehicle its modem has not confirmed; None: not known."""
        found: float | None = self._peer.get("per")
        return found

    @property
    def propagation_s(self) -> float:
        """The propagation delay, as measured; else the link's."""
        measured = self.metrics.get("propagation_s")
        if measured is not None:
            return measured
        capabilities = self._capabilities
        return SOUND_S if capabilities is None else float(capabilities["propagation_s"])

    @property
    def way_s(self) -> float:
        """How much older a report is than its stamp: airtime of half a frame, and the delay."""
        capabilities = self._capabilities
        if capabilities is None:
            return SOUND_S
        bits = capabilities["mtu_bytes"] * 8 / 2
        airtime_s = capabilities["preamble_s"] + bits / capabilities["bit_rate_bps"]
        return float(self.propagation_s + airtime_s)

    def airtime_share(self, now_s: float) -> float | None:
        """Return which share of the last minute the shore's modem was on the air."""
        while len(self._airtimes) > 1 and self._airtimes[1][0] <= now_s - WINDOW_S:
            self._airtimes.popleft()
        if not self._airtimes:
            return None
        (begun_s, before_s), (_, after_s) = self._airtimes[0], self._airtimes[-1]
        window_s = min(WINDOW_S, now_s - begun_s)
        return None if window_s < WINDOW_S / 4 else max(0.0, after_s - before_s) / window_s

    @property
    def lost_since_unix_s(self) -> float | None:
        """Since when nothing was heard of the vehicle for too long; None: it is there."""
        lost = self.documents.get(f"peer/{VEHICLE}/lost") or {}
        return lost["since_unix_s"] if lost.get("lost") else None

    # Queue and channel

    def waiting(self) -> list[Waiting]:
        """Return what has not arrived, as far as the gateway knows."""
        streams = (self.documents.get("streams") or {}).get("streams", [])
        found = (
            Waiting(each["name"], each["waiting"], each.get("delivering", 0)) for each in streams
        )
        return [each for each in found if each.queued or each.unacknowledged]

    def frames(self, unix_s: float) -> list[Frame]:
        """Return the frames of the last time, oldest first."""
        for key, frame in list(self._frames.items()):
            if frame.ended_unix_s < unix_s - FRAMES_S:
                del self._frames[key]
        return sorted(self._frames.values(), key=lambda frame: frame.begun_unix_s)

    def in_water(self, unix_s: float) -> list[tuple[Frame, float]]:
        """Return the frames on their way to the vehicle, and when they will be there, s from now.

        What the vehicle has sent is known when it has arrived, not before.
        """
        arrivals = (
            (frame, frame.ended_unix_s + self.propagation_s - unix_s)
            for frame in self.frames(unix_s)
            if frame.way == "out" and frame.outcome != "rejected"
        )
        return [(frame, left_s) for frame, left_s in arrivals if left_s > 0]

    def arriving(self, now_s: float) -> list[Arriving]:
        """Return the large samples that are on their way to the shore."""
        receiving = (self.documents.get("objects") or {}).get("receiving", [])
        return [self._arriving(each, now_s) for each in receiving]

    @property
    def _peer(self) -> dict[str, Any]:
        found: dict[str, Any] = (self.documents.get("peers") or {}).get(str(VEHICLE)) or {}
        return found

    @property
    def _capabilities(self) -> dict[str, Any] | None:
        found: dict[str, Any] | None = (self.documents.get("link") or {}).get("capabilities")
        return found

    def _take_frames(self, document: dict[str, Any]) -> None:
        told = [*document["last"], document["transmitting"]]
        for each in told:
            if each is not None:
                frame = msgspec.convert(each, Frame)
                self._frames[frame.way, frame.begun_unix_s] = frame
        while len(self._frames) > _FRAMES_MOST:
            del self._frames[next(iter(self._frames))]

    def _take_progress(self, document: dict[str, Any], now_s: float) -> None:
        before, self._progress = self._progress, {}
        for each in document["receiving"]:
            key = each["source"], each["transfer"]
            history = before.get(key) or deque(maxlen=64)
            done_bytes = each["done_bytes"]
            if history and now_s - history[-1][0] < _SOON_S:
                history[-1] = history[-1][0], done_bytes
            elif not history or history[-1][1] != done_bytes:
                history.append((now_s, done_bytes))
            self._progress[key] = history

    def _arriving(self, told: dict[str, Any], now_s: float) -> Arriving:
        done_bytes, total_bytes = told["done_bytes"], told["total_bytes"]
        history = self._progress.get((told["source"], told["transfer"]), deque())
        while len(history) > 2 and history[1][0] <= now_s - WINDOW_S:
            history.popleft()
        if not total_bytes:
            return Arriving(done_bytes, total_bytes, None, None)
        if len(history) < 2:
            return Arriving(done_bytes, total_bytes, None, done_bytes / total_bytes)
        # It comes in steps, a train of packets each: the next one is under way since the last.
        steps = [late[1] - early[1] for early, late in pairwise(history)]
        (first_s, first_bytes), (last_s, last_bytes) = history[0], history[-1]
        speed = (last_bytes - first_bytes) / (last_s - first_s)
        under_way_bytes = min(max(steps), speed * (now_s - last_s))
        here_bytes = min(total_bytes, done_bytes + under_way_bytes)
        left_s = (total_bytes - here_bytes) / speed if speed > 0 else None
        return Arriving(done_bytes, total_bytes, left_s, here_bytes / total_bytes)
