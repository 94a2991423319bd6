"""The ROS graph of one local network: the gateway's endpoints, and those of other nodes.

The problem: a client waits until it sees a server, a subscription asks a publisher's cache, and
`ros2 topic list` lists what has tokens. The gateway must provide all of that for remote endpoints,
without asking any remote node. And if a local program serves a service, the gateway must not:
otherwise both would execute a call, and the client would get two answers.

So the gateway's endpoints have tokens while it does their job, and it watches the tokens of other
nodes. It recognises other gateways by their enclave: they serve nobody, and messages with their
gids came from the channel.
"""

import threading
from collections.abc import Callable, Sequence
from typing import Final

import zenoh

from zacoustic.ros.names import RosKey, interface_of
from zacoustic.ros.qos import RosQos
from zacoustic.ros.tokens import PREFIX, Entity, RosNode, Token, gid_of, read_token
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.session.session import ZenohSession

ENCLAVE: Final = "/acoustic"
"""Enclave of the nodes of gateways."""
TOKENS_LIMIT: Final = 20_000
"""Most foreign tokens that are kept; more are ignored."""

_CALLED: Final = {
    Entity.PUBLISHER: "publishes",
    Entity.SUBSCRIPTION: "subscribes to",
    Entity.SERVER: "serves",
    Entity.CLIENT: "calls",
}


class Graph:
    """The known ROS graph of a local network.

    Args:
        domain: ``ROS_DOMAIN_ID``.
        address: Acoustic address of this gateway.
        zenoh_session: Its session.
        input_errors: Takes endpoints that do not fit.
        ring: Wakes the loop, which then calls `take`.
    """

    def __init__(
        self,
        domain: int,
        address: int,
        zenoh_session: ZenohSession,
        input_errors: InputErrors,
        ring: Callable[[], None],
    ) -> None:
        self.domain = domain
        self._zenoh_session = zenoh_session
        self._input_errors = input_errors
        self._ring = ring
        self.node = RosNode(
            domain=domain,
            zid=str(zenoh_session.session.zid()).lstrip("0"),
            number=0,
            name=f"acoustic_gateway_{address}",
            enclave=ENCLAVE,
        )
        self._numbers = 0
        self._expected: dict[str, tuple[str, RosKey, RosQos]] = {}
        self._declared: list[zenoh.LivelinessToken | zenoh.Subscriber[None]] = []
        self._guard = threading.Lock()
        self._seen: dict[str, Token] = {}
        self._servers: dict[str, set[str]] = {}
        self._news: dict[str, Token] = {}
        self._has_changed = False
        self._gids: set[bytes] = set()
        self._gone: dict[bytes, None] = {}
        """Gids of publishers whose tokens are gone, the latest last."""

    # The gateway's endpoints

    def endpoint(self, kind: Entity, key: RosKey, qos: RosQos) -> Token:
        """Return the token of an endpoint of the gateway; `announce` makes it visible."""
        with self._guard:
            self._numbers += 1
            number = self._numbers
        token = Token(
            node=self.node,
            number=number,
            kind=kind,
            topic=f"/{key.name}",
            type=key.type,
            hash=key.hash,
            qos=qos,
        )
        with self._guard:
            self._gids.add(gid_of(token))
        return token

    def announce(self, tokens: Sequence[Token]) -> list[zenoh.LivelinessToken]:
        """Make endpoints visible; in the worker."""
        liveliness = self._zenoh_session.session.liveliness()
        return [liveliness.declare_token(str(token)) for token in tokens]

    def expect(self, stream: str, key: RosKey, qos: RosQos) -> None:
        """Report endpoints of that name that do not fit the stream."""
        self._expected[f"/{key.name}"] = (stream, key, qos)

    async def open(self) -> None:
        """Announce the gateway's node, and watch other nodes."""
        await self._zenoh_session.worker.run(self._open)

    def undeclare(self) -> None:
        """Become invisible; in the worker."""
        while self._declared:
            self._declared.pop().undeclare()  # type: ignore[no-untyped-call]

    # Other nodes

    def take(self) -> bool:
        """Process observations, on the loop; return whether any endpoint came or went."""
        with self._guard:
            news, self._news = self._news, {}
            has_changed, self._has_changed = self._has_changed, False
        for token in news.values():
            self._compare(token)
        return has_changed

    def serves(self, key: RosKey) -> bool:
        """Return whether a local program serves a service."""
        with self._guard:
            return bool(self._servers.get(f"/{key.name}"))

    def has_gone(self, gid: bytes) -> bool:
        """Return whether the token of a publisher was there and is gone; on any thread."""
        with self._guard:
            return gid in self._gone

    def is_gateway(self, gid: bytes) -> bool:
        """Return whether a gid belongs to a gateway's endpoint; on any thread."""
        with self._guard:
            return gid in self._gids

    # Below the methods above

    def _open(self) -> None:
        session = self._zenoh_session.session
        token = Token(node=self.node, number=self.node.number, kind=Entity.NODE)
        self._declared.append(session.liveliness().declare_token(str(token)))
        self._declared.append(
            session.liveliness().declare_subscriber(
                zenoh.KeyExpr(f"{PREFIX}/{self.domain}/**"),
                self._zenoh_session.callback(self._see),
                history=True,
            )
        )

    def _see(self, sample: zenoh.Sample) -> None:
        """Note a token that appeared or disappeared; on Zenoh's thread."""
        key = str(sample.key_expr)
        token = read_token(key)
        if token is None or token.kind is Entity.NODE or token.node.zid == self.node.zid:
            return
        is_there = sample.kind == zenoh.SampleKind.PUT
        with self._guard:
            if token.node.enclave == ENCLAVE:
                # Kept after the endpoint is gone: its samples may still be on their way.
                if is_there and len(self._gids) < TOKENS_LIMIT:
                    self._gids.add(gid_of(key))
                return
            if is_there and len(self._seen) < TOKENS_LIMIT:
                self._seen[key] = token
                if token.topic in self._expected:
                    self._news[key] = token
            elif not is_there:
                self._seen.pop(key, None)
                self._news.pop(key, None)
            if token.kind is Entity.PUBLISHER:
                gid = gid_of(key)
                self._gone.pop(gid, None)
                if not is_there:
                    self._gone[gid] = None
                    if len(self._gone) > TOKENS_LIMIT:
                        del self._gone[next(iter(self._gone))]
            if token.kind is Entity.SERVER:
                keys = self._servers.setdefault(token.topic, set())
                (keys.add if key in self._seen else keys.discard)(key)
                if not keys:
                    del self._servers[token.topic]
                self._has_changed = True
        self._ring()

    def _compare(self, token: Token) -> None:
        """Report how an endpoint differs from the stream of its name."""
        stream, key, qos = self._expected[token.topic]
        who = f"{token.full_node_name} {_CALLED[token.kind]} it"
        if token.type != key.type:
            text = f"{who} as {interface_of(token.type)}, the stream is {interface_of(key.type)}"
        elif token.hash != key.hash:
            text = f"{who} with another definition of {interface_of(key.type)}, {token.hash}"
        elif (
            token.kind in (Entity.PUBLISHER, Entity.SUBSCRIPTION)
            and token.qos.durability is not qos.durability
        ):
            said, stated = token.qos.durability, qos.durability
            text = f"{who} as {said.name.lower()}, the stream is {stated.name.lower()}"
        else:
            return
        self._input_errors.add(stream, "graph", text)
