"""A node of ROS 2 on rmw_zenoh, as far as tests need one: tokens, CDR, attachments, caches.

What it does is what rmw_zenoh was seen to do: advanced publishers and subscribers, complete
queryables, clients that ask all complete servers and take each reply as it comes.
"""

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import zenoh
import zenoh.ext

from tests.gateway.networks import LIMIT_S, zenoh_config
from zacoustic.ros.attachment import Attachment, read_attachment
from zacoustic.ros.interfaces import Interfaces
from zacoustic.ros.mapping import TypeMapper
from zacoustic.ros.messages import RosMessage
from zacoustic.ros.names import RosKey, dds_type
from zacoustic.ros.qos import RosDurability, RosQos
from zacoustic.ros.tokens import Entity, RosNode, Token, gid_of, read_token

DEFAULT: Final = RosQos(depth=10)
LATCHED: Final = RosQos(depth=1, durability=RosDurability.TRANSIENT_LOCAL)


@contextmanager
def ros_session(port: int) -> Iterator[zenoh.Session]:
    """Connect a session as rmw_zenoh configures it: it stamps its samples."""
    settings = zenoh_config("client", connect=port)
    settings.insert_json5("timestamping/enabled", "true")
    with zenoh.open(settings) as session:
        yield session


class Told(asyncio.Queue[Any]):
    """What arrived, waited for on the loop."""

    def __init__(self) -> None:
        super().__init__()
        self._on = asyncio.get_running_loop()

    def tell(self, what: object) -> None:
        """Add something; from any thread."""
        self._on.call_soon_threadsafe(self.put_nowait, what)

    async def next(self) -> Any:
        """Wait for the next one."""
        async with asyncio.timeout(LIMIT_S):
            return await self.get()


class Node:
    """A node.

    Args:
        session: Its session.
        name: Its name.
        distro: Its distribution.
        domain: ``ROS_DOMAIN_ID``.
    """

    def __init__(
        self, session: zenoh.Session, name: str, *, distro: str = "jazzy", domain: int = 0
    ) -> None:
        self.session = session
        self._interfaces = Interfaces(distro)
        self._mapper = TypeMapper(self._interfaces)
        self._number = 0
        self._kept: list[Any] = []
        zid = str(session.zid()).lstrip("0")
        self.node = RosNode(domain=domain, zid=zid, number=0, name=name)
        self._announce(Token(node=self.node, number=0, kind=Entity.NODE))

    def key(self, name: str, interface: str) -> RosKey:
        digest = self._interfaces.hash_of(interface)
        return RosKey(
            domain=self.node.domain,
            name=name.lstrip("/"),
            type=dds_type(interface),
            hash=digest,
        )

    def message(self, interface: str) -> RosMessage:
        return RosMessage(self._interfaces, self._mapper, interface)

    def zero(self, interface: str) -> dict[str, Any]:
        """Return a message that nobody has filled in."""
        message = self.message(interface)
        return message.read(message.write({}))[0]

    def endpoint(
        self, kind: Entity, name: str, interface: str, qos: RosQos = DEFAULT
    ) -> tuple[Token, zenoh.LivelinessToken]:
        self._number += 1
        key = self.key(name, interface)
        token = Token(
            node=self.node,
            number=self._number,
            kind=kind,
            topic=f"/{key.name}",
            type=key.type,
            hash=key.hash,
            qos=qos,
        )
        return token, self._announce(token)

    def publisher(
        self, name: str, interface: str, qos: RosQos = DEFAULT
    ) -> Callable[[dict[str, Any]], None]:
        token, _ = self.endpoint(Entity.PUBLISHER, name, interface, qos)
        is_latched = qos.durability is RosDurability.TRANSIENT_LOCAL
        publisher = zenoh.ext.declare_advanced_publisher(
            self.session,
            str(self.key(name, interface)),
            cache=zenoh.ext.CacheConfig(max_samples=qos.depth) if is_latched else None,
            publisher_detection=is_latched,
        )
        self._kept.append(publisher)
        message, gid, count = self.message(interface), gid_of(token), 0

        def publish(value: dict[str, Any]) -> None:
            nonlocal count
            count += 1
            beside = Attachment(sequence=count, stamp_ns=time.time_ns(), gid=gid)
            publisher.put(message.write(value), attachment=beside.encode())

        return publish

    def subscribe(self, name: str, interface: str, qos: RosQos = DEFAULT) -> Told:
        """Subscribe; what comes is pairs of value and attachment."""
        told = Told()
        message = self.message(interface)

        def take(sample: zenoh.Sample) -> None:
            assert sample.attachment is not None, "rmw_zenoh drops what has none"
            beside = read_attachment(sample.attachment.to_bytes())
            told.tell((message.read(sample.payload.to_bytes())[0], beside))

        self.endpoint(Entity.SUBSCRIPTION, name, interface, qos)
        is_latched = qos.durability is RosDurability.TRANSIENT_LOCAL
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth)
        subscriber = zenoh.ext.declare_advanced_subscriber(
            self.session,
            str(self.key(name, interface)),
            zenoh.handlers.Callback(take),
            history=history if is_latched else None,
        )
        self._kept.append(subscriber)
        return told

    def serve(
        self, name: str, interface: str, answer: Callable[[dict[str, Any]], dict[str, Any] | None]
    ) -> list[Any]:
        """Serve; returns what is to be undeclared to end that. None is no answer yet."""
        request, response = (
            self.message(f"{interface}_{part}") for part in ("Request", "Response")
        )

        def take(query: zenoh.Query) -> None:
            assert query.payload is not None
            assert query.attachment is not None
            beside = read_attachment(query.attachment.to_bytes())
            assert beside is not None
            self._kept.append(query)  # before anybody can look for it
            value = answer(request.read(query.payload.to_bytes())[0])
            if value is not None:
                self.forget(query)
                reply(query, response.write(value))

        queryable = self.session.declare_queryable(
            str(self.key(name, interface)), take, complete=True
        )
        _, token = self.endpoint(Entity.SERVER, name, interface)
        self._kept.append(queryable)
        return [token, queryable]

    def held(self) -> list[zenoh.Query]:
        """Return the questions that have no answer yet, oldest first."""
        return [each for each in self._kept if isinstance(each, zenoh.Query)]

    def forget(self, query: zenoh.Query) -> None:
        """A question is going to be answered."""
        self._kept.remove(query)

    def client(self, name: str, interface: str) -> "Client":
        token, _ = self.endpoint(Entity.CLIENT, name, interface)
        return Client(self, name, interface, gid_of(token))

    async def available(self, kind: Entity, name: str, *, is_there: bool = True) -> Token | None:
        """Wait until somebody else's endpoint is seen, or is gone; by tokens alone."""
        told = Told()
        seen: dict[str, Token] = {}

        def see(sample: zenoh.Sample) -> None:
            key = str(sample.key_expr)
            token = read_token(key)
            if token is None or token.kind is not kind or token.topic != name:
                return
            if token.node.zid != self.node.zid:
                told.tell((key, token, sample.kind == zenoh.SampleKind.PUT))

        watcher = self.session.liveliness().declare_subscriber(
            f"@ros2_lv/{self.node.domain}/**", see, history=True
        )
        try:
            if not is_there:
                replies = self.session.liveliness().get(f"@ros2_lv/{self.node.domain}/**")
                keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
                if not any(self._is_such(key, kind, name) for key in keys):
                    return None
            while True:
                key, token, is_here = await told.next()
                if is_here:
                    seen[key] = token
                else:
                    seen.pop(key, None)
                if is_there and seen:
                    return next(iter(seen.values()))
                if not is_there and not seen:
                    return None
        finally:
            watcher.undeclare()  # type: ignore[no-untyped-call]

    def _is_such(self, key: str, kind: Entity, name: str) -> bool:
        token = read_token(key)
        return (
            token is not None
            and token.kind is kind
            and token.topic == name
            and token.node.zid != self.node.zid
        )

    def _announce(self, token: Token) -> zenoh.LivelinessToken:
        declared = self.session.liveliness().declare_token(str(token))
        self._kept.append(declared)
        return declared


class Client:
    """A client of a service; made by `Node.client`."""

    def __init__(self, node: Node, name: str, interface: str, gid: bytes) -> None:
        self.gid = gid
        self._key = str(node.key(name, interface))
        self._request = node.message(f"{interface}_Request")
        self._response = node.message(f"{interface}_Response")
        self._session = node.session
        self._count = 0
        self.errors: list[str] = []
        """The texts of error replies."""

    def ask(self, value: dict[str, Any]) -> Told:
        """Ask all complete servers; replies come as pairs of value and attachment, then None."""
        told = Told()
        self._count += 1

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is None:  # rmw_zenoh logs it
                assert reply.err is not None
                self.errors.append(reply.err.payload.to_string())
                return
            assert reply.ok.attachment is not None
            beside = read_attachment(reply.ok.attachment.to_bytes())
            told.tell((self._response.read(reply.ok.payload.to_bytes())[0], beside))

        beside = Attachment(sequence=self._count, stamp_ns=time.time_ns(), gid=self.gid)
        self._session.get(
            self._key,
            zenoh.handlers.Callback(take, lambda: told.tell(None)),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            payload=self._request.write(value),
            attachment=beside.encode(),
            timeout=LIMIT_S,
        )
        return told

    async def call(self, value: dict[str, Any]) -> list[tuple[dict[str, Any], Attachment]]:
        """Ask, and wait for all replies."""
        told, replies = self.ask(value), []
        while (reply := await told.next()) is not None:
            replies.append(reply)
        return replies


def reply(query: zenoh.Query, payload: bytes) -> None:
    """Answer as rmw_zenoh does: number and gid of the request, and the time."""
    assert query.attachment is not None
    beside = read_attachment(query.attachment.to_bytes())
    assert beside is not None
    again = Attachment(sequence=beside.sequence, stamp_ns=time.time_ns(), gid=beside.gid)
    with query:
        query.reply(query.key_expr, payload, attachment=again.encode())
