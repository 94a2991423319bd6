"""The vehicle as a node of ROS 2 on rmw_zenoh: its keys, CDR, attachments and liveliness tokens.

ROS is not needed for it. What the topics and services are, `fleet_ros.json5` says to gateway and
vehicle alike (`Config.ros`). `ros2 node list`, `topic echo`, `service call` and `action send_goal`
on the network of the vehicle find it as they find any node.
"""

import time
from collections.abc import Callable
from typing import Any, Final

import zenoh
import zenoh.ext

from examples.auv.messages import GOTO
from examples.auv.roswords import FLEET, from_ros, name_in_ros, to_ros
from examples.auv.speech import Later, Question, Said, Speech
from zacoustic import read_config
from zacoustic.config.ros import RosConfig
from zacoustic.ros.attachment import Attachment, read_attachment
from zacoustic.ros.messages import RosMessage
from zacoustic.ros.names import RosKey
from zacoustic.ros.qos import RosQos
from zacoustic.ros.streams import SERVICE_QOS, STATUS_QOS, RosAction, RosService, RosTopic
from zacoustic.ros.tokens import Entity, RosNode, Token, gid_of

NODE: Final = "vehicle"
_ACTION: Final = f"{GOTO}/_action"
_STATUS: Final = f"{_ACTION}/status"
_CODES: Final = {"accepted": 1, "executing": 2, "succeeded": 4, "canceled": 5, "aborted": 6}
_GOALS_TOLD: Final = 8
"""Goals whose status is published, the newest."""
_REJECTED: Final = 1
_BYTES_OF_ID: Final = 16

Served = tuple[RosKey, RosMessage, RosMessage]
Told = tuple[RosKey, RosMessage, RosQos]


class RosSpeech(Speech):
    """Says and hears as a node.

    Args:
        session: Zenoh's; it should stamp its samples.
        later: Where what arrives is done.
        address: Of the vehicle, in the file.
    """

    def __init__(self, session: zenoh.Session, later: Later, address: int) -> None:
        config = read_config(FLEET, address=address)
        assert config.ros is not None
        self._session = session
        self._later = later
        self._number = 0
        self._kept: list[object] = []
        self._topics: dict[str, Told] = {}
        self._services: dict[str, Served] = {}
        self._publishers: dict[str, Callable[[bytes], None]] = {}
        self._states: dict[bytes, int] = {}
        for stream in config.table:
            if stream.stream_id in config.ros.streams:
                self._learn(config.ros, stream.stream_id, stream.name)
        zid = str(session.zid()).lstrip("0")
        self._node = RosNode(
            domain=config.ros.domain, zid=zid, number=0, name=NODE, namespace="/auv1"
        )
        self._announce(Token(node=self._node, number=0, kind=Entity.NODE))

    def publish(self, topic: str, said: Said | bytes) -> None:
        """Publish a message; the first one announces the publisher."""
        if topic.startswith(_ACTION) and isinstance(said, dict):
            said = said | {"goal_id": {"uuid": said["goal_id"]}}
        self._put(topic, to_ros(topic, said))

    def advertise(self, *topics: str) -> None:
        """Announce publishers, before anything is published."""
        for topic in topics:
            self._publisher(topic)

    def subscribe(self, topic: str, take: Callable[[Said], None]) -> None:
        """Declare a subscription."""
        key, message, qos = self._topics[name_in_ros(topic)]

        def hear(sample: zenoh.Sample) -> None:
            payload = sample.payload.to_bytes()
            self._later(lambda: take(from_ros(topic, message.read(payload)[0])))

        self._kept.append(self._session.declare_subscriber(str(key), hear))
        self._endpoint(Entity.SUBSCRIPTION, key, qos)

    def serve(self, service: str, take: Callable[[Question], None]) -> None:
        """Declare a server."""
        key, request, response = self._services[service]
        part = service.removeprefix(f"{_ACTION}/")

        def hear(query: zenoh.Query) -> None:
            payload = query.payload.to_bytes() if query.payload else b""
            said = request.read(payload)[0]
            self._later(lambda: take(_RosQuestion(query, part, said, response, self._tell_state)))

        self._kept.append(self._session.declare_queryable(str(key), hear, complete=True))
        self._endpoint(Entity.SERVER, key, SERVICE_QOS)

    # Below the methods above

    def _learn(self, ros: RosConfig, stream_id: int, name: str) -> None:
        """Note keys and messages of a stream."""
        said, domain = ros.streams[stream_id], ros.domain
        match said:
            case RosTopic():
                self._topics[name] = (said.key(domain, name), said.message, said.qos)
            case RosService():
                self._services[name] = (said.key(domain, name), said.request, said.response)
            case RosAction():
                services = ("send_goal", said.send_goal), ("get_result", said.get_result)
                for part, each in (*services, ("cancel_goal", said.cancel_goal)):
                    called = f"{name}/_action/{part}"
                    self._services[called] = (each.key(domain, called), each.request, each.response)
                for part, told in (("feedback", said.feedback), ("status", said.status)):
                    called = f"{name}/_action/{part}"
                    self._topics[called] = (told.key(domain, called), told.message, told.qos)

    def _publisher(self, topic: str) -> Callable[[bytes], None]:
        put = self._publishers.get(topic)
        if put is None:
            key, _, qos = self._topics[name_in_ros(topic)]
            put = self._publishers[topic] = self._declare(key, qos)
        return put

    def _declare(self, key: RosKey, qos: RosQos) -> Callable[[bytes], None]:
        is_latched = qos == STATUS_QOS
        publisher = zenoh.ext.declare_advanced_publisher(
            self._session,
            str(key),
            cache=zenoh.ext.CacheConfig(max_samples=qos.depth) if is_latched else None,
            publisher_detection=is_latched,
        )
        gid, count = gid_of(self._endpoint(Entity.PUBLISHER, key, qos)), 0

        def put(payload: bytes) -> None:
            nonlocal count
            count += 1
            beside = Attachment(sequence=count, stamp_ns=time.time_ns(), gid=gid)
            publisher.put(payload, attachment=beside.encode())

        return put

    def _put(self, topic: str, value: dict[str, Any]) -> None:
        message = self._topics[name_in_ros(topic)][1]
        self._publisher(topic)(message.write(message.spec.validate(value)))

    def _tell_state(self, goal_id: bytes, status: str) -> None:
        """A goal has another state: publish it, as action servers do."""
        self._states = {**self._states, goal_id: _CODES[status]}
        while len(self._states) > _GOALS_TOLD:
            del self._states[next(iter(self._states))]
        listed = [
            {"goal_info": {"goal_id": {"uuid": each}, "stamp": _now()}, "status": code}
            for each, code in self._states.items()
        ]
        self._put(_STATUS, {"status_list": listed})

    def _endpoint(self, kind: Entity, key: RosKey, qos: RosQos) -> Token:
        self._number += 1
        token = Token(
            node=self._node,
            number=self._number,
            kind=kind,
            topic=f"/{key.name}",
            type=key.type,
            hash=key.hash,
            qos=qos,
        )
        self._announce(token)
        return token

    def _announce(self, token: Token) -> None:
        self._kept.append(self._session.liveliness().declare_token(str(token)))


class _RosQuestion(Question):
    """A request; the action's in the vehicle's form."""

    def __init__(
        self,
        query: zenoh.Query,
        part: str,
        said: Said,
        response: RosMessage,
        tell_state: Callable[[bytes, str], None],
    ) -> None:
        info = said.get("goal_info", said)
        self._goal_id: bytes = info["goal_id"]["uuid"] if "goal_id" in info else b""
        super().__init__(said | {"goal_id": self._goal_id} if self._goal_id else said)
        self._query = query
        self._part = part
        self._response = response
        self._tell_state = tell_state

    def answer(self, said: Said) -> None:
        """Reply as rmw_zenoh does: number and gid of the request, and the time."""
        written: Said = said
        match self._part:
            case "send_goal":
                written = {"accepted": said["accepted"], "stamp": _now()}
            case "cancel_goal":
                info = {"goal_id": {"uuid": self._goal_id}, "stamp": _now()}
                done = bool(said["accepted"])
                written = {
                    "return_code": 0 if done else _REJECTED,
                    "goals_canceling": [info] * done,
                }
            case "get_result":
                written = {"status": _CODES[said["status"]], "result": said["result"]}
        attachment = self._query.attachment
        asked = read_attachment(attachment.to_bytes()) if attachment is not None else None
        beside = Attachment(
            sequence=asked.sequence if asked else 0,
            stamp_ns=time.time_ns(),
            gid=asked.gid if asked else bytes(_BYTES_OF_ID),
        )
        payload = self._response.write(self._response.spec.validate(written))
        with self._query as query:
            query.reply(query.key_expr, payload, attachment=beside.encode())
        if self._part == "send_goal" and said["accepted"]:
            self._tell_state(self._goal_id, "executing")
        elif self._part == "get_result":
            self._tell_state(self._goal_id, said["status"])


def _now() -> dict[str, int]:
    seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
    return {"sec": seconds, "nanosec": nanoseconds}
