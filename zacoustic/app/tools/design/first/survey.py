"""The contents of a Zenoh network: published topics, offered and called services.

One session, one subscriber for each expression. Its callback only stores, in bounded memory: the
first payloads of each key, and counts. Latched samples were published long ago: those who keep them
are asked. Services are not samples; a router lists them in its admin space if that is enabled
(``adminspace: { enabled: true }``). A network of peers has no router: the session is a peer then.
"""

import json
import re
import statistics
import threading
import time
from collections import deque
from collections.abc import Sequence
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
_GOSSIP_S: Final = 1.0
"""Time in which a peer meets the others."""
_Kept = tuple[bytes, str]
"""Payload and encoding of a latched sample."""
_LISTED: Final = re.compile(r"@/[^/]+/[^/]+/(?:queryable|querier|subscriber)/(.+)")
_ROS_TOKENS: Final = "@ros2_lv/**"
_CACHES: Final = "**/@adv/**"
"""Queryables of Zenoh's advanced publishers, which keep what late subscribers get."""
_KEPT_OF: Final = "_max=64;_anyke"
"""Parameters for them: the newest samples, on the keys on which they were published."""


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
    kept: int = 0
    """Number of samples that its publishers keep for late subscribers; 0: it is not latched."""


class Survey(msgspec.Struct, frozen=True, kw_only=True):
    """The result of listening."""

    endpoint: str | None
    """Endpoint of the router, or of a peer; None: peers were found by multicast."""
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
    called: tuple[str, ...] = ()
    """Keys without wildcards at which somebody asks and nobody answers."""
    left_out: int = 0
    """Samples on keys beyond `KEYS_LIMIT`."""
    ids: tuple[str, ...] = ()
    """Zenoh ids of its routers and of the sessions of ROS nodes."""
    has_router: bool = True
    """A router answered; otherwise the network is one of peers."""
    ended_utc_ns: int | None = None
    """Instant of the end by this machine's clock, ns since 1970; None: unknown."""


def survey_network(
    endpoint: str | None, *, listen_s: float, expressions: Sequence[str] = ("**",)
) -> Survey:
    """Listen to a network through one of its routers or peers; blocks.

    Args:
        endpoint: Endpoint of a router or a peer, such as ``tcp/127.0.0.1:7447``; None: the peers
            that multicast finds.
        listen_s: Time of listening, s.
        expressions: Key expressions of the topics. A chunk that begins with ``@`` is covered by no
            wildcard: it must be named.

    Raises:
        SessionError: Nobody answers there, or a key expression is not valid.
    """
    ears = _Ears()
    with _open(endpoint, listen_s) as session:
        has_router = bool(session.info.routers_zid())
        ids = {str(zid).lstrip("0") for zid in (*session.info.routers_zid(), *_routers(session))}
        for expression in expressions:
            try:
                session.declare_subscriber(expression, ears.hear)
            except zenoh.ZError as error:
                reason = " ".join(str(error).split(" at ")[0].split())
                raise SessionError(f"{expression!r} is no key expression: {reason}") from error
        started_at = time.monotonic()
        threading.Event().wait(0 if has_router else min(_GOSSIP_S, listen_s / 4))
        services, tells_services = _listed(session, "queryable")
        subscribed, _ = _listed(session, "subscriber")
        called, _ = _listed(session, "querier")
        tokens = _ros_tokens(session)
        threading.Event().wait(max(0.0, listen_s - (time.monotonic() - started_at)))
        covered = [zenoh.KeyExpr(expression) for expression in expressions]

        def covers(key: str) -> bool:
            return any(each.intersects(zenoh.KeyExpr(key)) for each in covered)

        for key, kept in _kept(session).items():
            if covers(key):
                ears.keep(key, kept)
        # Nodes that started meanwhile; those that ended meanwhile are on the network, too.
        tokens = tuple(sorted({*tokens, *_ros_tokens(session)}))
    topics = ears.topics(listen_s)
    published = {topic.key for topic in topics}
    return Survey(
        endpoint=endpoint,
        listened_s=listen_s,
        topics=topics,
        subscribed=tuple(key for key in subscribed if key not in published and covers(key)),
        ros_tokens=tokens,
        services=services,
        called=tuple(key for key in called if key not in services),
        tells_services=tells_services,
        left_out=ears.left_out,
        ids=tuple(sorted({*ids, *(token.split("/")[2].lstrip("0") for token in tokens)})),
        has_router=has_router,
        ended_utc_ns=time.time_ns(),
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

    def keep(self, key: str, kept: Sequence[_Kept]) -> None:
        """Note what publishers keep: also a topic on which nothing was published meanwhile."""
        with self._guard:
            heard = self._heard.get(key)
            if heard is None and len(self._heard) < KEYS_LIMIT:
                heard = self._heard[key] = _Heard()
            if heard is not None:
                heard.keep(kept)

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
        self._kept = 0

    def keep(self, kept: Sequence[_Kept]) -> None:
        self._kept = len(kept)
        if not self._samples:
            for payload, encoding in kept:
                self._note(payload, encoding)

    def take(self, payload: bytes, encoding: str, instant_s: float) -> None:
        if self._last_s is not None:
            self._gaps_s.append(instant_s - self._last_s)
        self._last_s = instant_s
        self._samples += 1
        self._note(payload, encoding)

    def _note(self, payload: bytes, encoding: str) -> None:
        size = len(payload)
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
            kept=self._kept,
        )


def _open(endpoint: str | None, listen_s: float) -> zenoh.Session:
    """Open a session: a client of a router, or a peer among peers."""
    try:
        if endpoint is None:
            return _open_peer(None)
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("connect/timeout_ms", str(_CONNECT_LIMIT_MS))
        config.insert_json5("scouting/multicast/enabled", "false")
        session = zenoh.open(config)
        if session.info.routers_zid() or not session.info.peers_zid():
            return session
        # A peer passes nothing on from other peers: this session meets them by its gossip.
        session.close()  # type: ignore[no-untyped-call]
        return _open_peer(endpoint)
    except zenoh.ZError as error:
        raise SessionError(
            f"no Zenoh router at {endpoint}, nor a peer",
            hint="start it, or correct --connect: tcp/HOST:7447",
        ) from error


def _open_peer(endpoint: str | None) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("scouting/multicast/enabled", json.dumps(endpoint is None))
    if endpoint is not None:
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    return zenoh.open(config)


def _kept(session: zenoh.Session) -> dict[str, list[_Kept]]:
    """Return what advanced publishers keep for late subscribers, by key."""
    found: dict[str, list[_Kept]] = {}
    replies = session.get(
        f"{_CACHES}?{_KEPT_OF}",
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=_ASK_LIMIT_S,
    )
    for reply in replies:
        sample = reply.ok
        if sample is not None and sample.kind == zenoh.SampleKind.PUT:
            encoding = str(sample.encoding).partition(";")[0]
            found.setdefault(str(sample.key_expr), []).append((sample.payload.to_bytes(), encoding))
    return found


def _listed(session: zenoh.Session, kind: str) -> tuple[tuple[str, ...], bool]:
    """Return what the routers list, and whether any router lists something.

    Args:
        session: The session.
        kind: ``queryable``, ``querier`` or ``subscriber``.

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
        reply.ok is not None for reply in session.get("@/*/*", timeout=_ASK_LIMIT_S)
    )
    return tuple(sorted(keys)), tells


def _routers(session: zenoh.Session) -> set[str]:
    """Return the ids of all routers, as far as they tell."""
    replies = session.get("@/*/router", timeout=_ASK_LIMIT_S)
    return {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok is not None}


def _ros_tokens(session: zenoh.Session) -> tuple[str, ...]:
    """Return the tokens of ROS nodes; they tell names, types and who only subscribes."""
    replies = session.liveliness().get(_ROS_TOKENS, timeout=_ASK_LIMIT_S)
    return tuple(sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None}))
