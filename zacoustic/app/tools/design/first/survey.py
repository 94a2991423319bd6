"""The contents of a Zenoh network: published topics, offered services.

One session, one subscriber. Its callback only stores, in bounded memory: the first payloads of each
key, and counts. Services are not samples; a router lists them in its admin space if that is enabled
(``adminspace: { enabled: true }``).
"""

import json
import re
import statistics
import threading
import time
from collections import deque
from typing import Final

import msgspec
import zenoh

from zacoustic.errors import SessionError

KEYS_LIMIT: Final = 1000
"""Most keys to examine; further ones are only counted."""
PAYLOADS_LIMIT: Final = 64
"""Most stored payloads of a key."""
GAPS_LIMIT: Final = 256
"""Most times between samples that a period is the median of."""
PAYLOAD_LIMIT_BYTES: Final = 4096
"""Larger payloads are only counted: they are not values of a type."""

_EPOCH_S: Final = time.monotonic()
_ASK_LIMIT_S: Final = 2.0
_CONNECT_LIMIT_MS: Final = 3000
_LISTED: Final = re.compile(r"@/[^/]+/[^/]+/(?:queryable|subscriber)/(.+)")
_ROS_TOKENS: Final = "@ros2_lv/**"


class SeenTopic(msgspec.Struct, frozen=True, kw_only=True):
    """One key with published samples."""

    key: str
    """The key."""
    samples: int
    """Number of samples."""
    rate_hz: float
    """Samples per second while listening."""
    encoding: str
    """Encoding of most of them, without its schema."""
    smallest_bytes: int
    """Smallest payload."""
    largest_bytes: int
    """Largest payload."""
    payloads: tuple[bytes, ...] = ()
    """The first payloads, in order."""
    period_s: float | None = None
    """Median time between two samples, s; None: there was only one."""
    last_s: float = 0.0
    """Instant of the last sample, s since an epoch that all surveys of this process have."""


class Survey(msgspec.Struct, frozen=True, kw_only=True):
    """The result of listening."""

    endpoint: str
    """Endpoint of the router."""
    listened_s: float
    """Time of listening, s."""
    topics: tuple[SeenTopic, ...]
    """By key."""
    services: tuple[str, ...]
    """Keys of queryables, by name."""
    tells_services: bool
    """The router has an admin space; otherwise `services` and `subscribed` are always empty."""
    subscribed: tuple[str, ...] = ()
    """Keys without wildcards to which somebody subscribes and nobody published."""
    ros_tokens: tuple[str, ...] = ()
    """Liveliness tokens of ROS nodes."""
    left_out: int = 0
    """Samples on keys beyond `KEYS_LIMIT`."""


def survey_network(endpoint: str, *, listen_s: float, expression: str = "**") -> Survey:
    """Listen to a network through one of its routers; blocks.

    Args:
        endpoint: Endpoint of the router, such as ``tcp/127.0.0.1:7447``.
        listen_s: Time of listening, s.
        expression: Key expression of the topics.

    Raises:
        SessionError: No router answers there, or the key expression is not valid.
    """
    ears = _Ears()
    with _open(endpoint) as session:
        try:
            session.declare_subscriber(expression, ears.hear)
        except zenoh.ZError as error:
            reason = " ".join(str(error).split(" at ")[0].split())
            raise SessionError(f"{expression!r} is no key expression: {reason}") from error
        started_at = time.monotonic()
        services, tells_services = _listed(session, "queryable")
        subscribed, _ = _listed(session, "subscriber")
        tokens = _ros_tokens(session)
        threading.Event().wait(max(0.0, listen_s - (time.monotonic() - started_at)))
    topics = ears.topics(listen_s)
    published = {topic.key for topic in topics}
    return Survey(
        endpoint=endpoint,
        listened_s=listen_s,
        topics=topics,
        subscribed=tuple(
            key
            for key in subscribed
            if key not in published and zenoh.KeyExpr(expression).intersects(zenoh.KeyExpr(key))
        ),
        ros_tokens=tokens,
        services=services,
        tells_services=tells_services,
        left_out=ears.left_out,
    )


class _Ears:
    """Takes samples on Zenoh's thread."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._heard: dict[str, _Heard] = {}
        self.left_out = 0

    def hear(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        key, payload = str(sample.key_expr), sample.payload.to_bytes()
        with self._guard:
            heard = self._heard.get(key)
            if heard is None and len(self._heard) >= KEYS_LIMIT:
                self.left_out += 1
                return
            if heard is None:
                heard = self._heard[key] = _Heard()
            heard.take(payload, str(sample.encoding).partition(";")[0], time.monotonic())

    def topics(self, listened_s: float) -> tuple[SeenTopic, ...]:
        with self._guard:
            return tuple(heard.topic(key, listened_s) for key, heard in sorted(self._heard.items()))


class _Heard:
    """The samples of one key."""

    def __init__(self) -> None:
        self._sizes: list[int] = []
        self._encodings: dict[str, int] = {}
        self._payloads: list[bytes] = []
        self._samples = 0
        self._gaps_s: deque[float] = deque(maxlen=GAPS_LIMIT)
        self._last_s: float | None = None

    def take(self, payload: bytes, encoding: str, instant_s: float) -> None:
        size = len(payload)
        if self._last_s is not None:
            self._gaps_s.append(instant_s - self._last_s)
        self._last_s = instant_s
        self._samples += 1
        self._sizes = [min([size, *self._sizes]), max([size, *self._sizes])]
        self._encodings[encoding] = self._encodings.get(encoding, 0) + 1
        if len(self._payloads) < PAYLOADS_LIMIT and size <= PAYLOAD_LIMIT_BYTES:
            self._payloads.append(payload)

    def topic(self, key: str, listened_s: float) -> SeenTopic:
        return SeenTopic(
            key=key,
            samples=self._samples,
            rate_hz=self._samples / listened_s if listened_s else 0.0,
            encoding=max(self._encodings, key=lambda encoding: self._encodings[encoding]),
            smallest_bytes=self._sizes[0],
            largest_bytes=self._sizes[1],
            payloads=tuple(self._payloads),
            period_s=statistics.median(self._gaps_s) if self._gaps_s else None,
            last_s=max(0.0, (self._last_s or _EPOCH_S) - _EPOCH_S),
        )


def _open(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    try:
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("connect/timeout_ms", str(_CONNECT_LIMIT_MS))
        config.insert_json5("scouting/multicast/enabled", "false")
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise SessionError(
            f"no Zenoh router at {endpoint}",
            hint="start it, or correct --connect: tcp/HOST:7447",
        ) from error


def _listed(session: zenoh.Session, kind: str) -> tuple[tuple[str, ...], bool]:
    """Return what the routers list, and whether any router lists something.

    Args:
        session: The session.
        kind: ``queryable`` or ``subscriber``.

    Returns:
        Keys without wildcards, and none of Zenoh's own; whether there is an admin space.
    """
    keys: set[str] = set()
    replies = list(session.get(f"@/*/*/{kind}/**", timeout=_ASK_LIMIT_S))
    for reply in replies:
        found = _LISTED.fullmatch(str(reply.ok.key_expr)) if reply.ok is not None else None
        if found is not None and not (found[1].startswith("@") or {"*", "$"} & {*found[1]}):
            keys.add(found[1])
    tells = bool(keys) or any(
        reply.ok is not None for reply in session.get("@/*/router", timeout=_ASK_LIMIT_S)
    )
    return tuple(sorted(keys)), tells


def _ros_tokens(session: zenoh.Session) -> tuple[str, ...]:
    """Return the tokens of ROS nodes; they tell names, types and who only subscribes."""
    replies = session.liveliness().get(_ROS_TOKENS, timeout=_ASK_LIMIT_S)
    return tuple(sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None}))
