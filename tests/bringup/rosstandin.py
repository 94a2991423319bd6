"""ROS 2's Python modules, as far as `zacoustic_bringup` needs them; ROS is not installed here.

Nodes are `tests.gateway.rosnode.Node`: they speak as rmw_zenoh does, on real Zenoh sessions.
Callbacks run on the loop, one at a time, as in an executor of one thread. What starts processes is
kept and not started. Arguments are those of Humble, and no other is taken.
"""

import asyncio
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any, Final

import msgspec
import zenoh

from tests.gateway.rosnode import DEFAULT, reply
from tests.gateway.rosnode import Node as Peer
from zacoustic.ros.tokens import Entity, read_token

_DOMAIN: Final = 0


class Here(msgspec.Struct):
    """Where and how the next node starts: what `ros2 run` and a launch file say."""

    session: zenoh.Session
    namespace: str = ""
    parameters: dict[str, Any] = {}
    logged: list[str] = []
    nodes: list["Node"] = []


_here: list[Here] = []


class Message:
    """A message, a request or a response: its members are attributes."""

    def __init__(self, members: dict[str, Any]) -> None:
        self.__dict__.update(members)


class _Kind:
    """Makes messages that nobody has filled in."""

    def __init__(self, interface: str) -> None:
        self.interface = interface

    def __call__(self) -> Message:
        return Message(_here[-1].nodes[-1].peer.zero(self.interface))


def get_message(interface: str) -> Any:
    """Return the class of a message."""
    return _Kind(interface)


def get_service(interface: str) -> Any:
    """Return the class of a service."""
    return SimpleNamespace(
        interface=interface,
        Request=_Kind(f"{interface}_Request"),
        Response=_Kind(f"{interface}_Response"),
    )


def set_message_fields(made: Message, values: dict[str, Any]) -> None:
    """Fill in members; an unknown one is an error, as in ROS."""
    for name, value in values.items():
        if name not in made.__dict__:
            raise AttributeError(name)
        setattr(made, name, value)


class _Future:
    def __init__(self) -> None:
        self._result: Any = None
        self._take: Callable[[Any], None] | None = None

    def add_done_callback(self, take: Callable[[Any], None]) -> None:
        self._take = take

    def result(self) -> Any:
        return self._result

    def end(self, result: Any) -> None:
        self._result = result
        if self._take is not None:
            self._take(self)


class _Client:
    def __init__(self, node: "Node", kind: Any, name: str) -> None:
        self._node, self._name = node, name
        self._client = node.peer.client(name, kind.interface)
        self._tasks: set[asyncio.Task[None]] = set()

    def service_is_ready(self) -> bool:
        return (Entity.SERVER, self._name) in self._node.graph()

    def call_async(self, request: Message) -> _Future:
        future = _Future()
        told = self._client.ask(request.__dict__)

        async def wait() -> None:
            answer = await told.next()
            if answer is not None:  # a client of rmw_zenoh only logs errors, and waits on
                future.end(Message(answer[0]))

        task = asyncio.get_running_loop().create_task(wait())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return future


class _Publisher:
    def __init__(self, node: "Node", kind: Any, name: str, depth: int) -> None:
        self._node, self._name = node, name
        self._put = node.peer.publisher(
            name, kind.interface, msgspec.structs.replace(DEFAULT, depth=depth)
        )

    def publish(self, message: Message) -> None:
        self._put(message.__dict__)

    def get_subscription_count(self) -> int:
        return int((Entity.SUBSCRIPTION, self._name) in self._node.graph())


class _Log:
    def __init__(self, lines: list[str]) -> None:
        self.warning = self.error = lines.append


class Node:
    """`rclpy.node.Node`."""

    def __init__(self, name: str) -> None:
        here = self._here = _here[-1]
        here.nodes.append(self)
        self.peer = Peer(here.session, name)
        self.declared: dict[str, Any] = {}
        self.timers: list[Callable[[], None]] = []
        self._loop = asyncio.get_running_loop()

    def declare_parameter(self, name: str, value: Any) -> Any:
        given = self._here.parameters.get(name, value)
        assert type(given) is type(value), f"InvalidParameterTypeException: {name}"
        self.declared[name] = value
        return SimpleNamespace(value=given)

    def create_service(
        self, kind: Any, name: str, callback: Callable[[Message, Message], Message]
    ) -> None:
        response = kind.Response

        def answer(request: dict[str, Any]) -> None:
            self._loop.call_soon_threadsafe(serve, request)

        def serve(request: dict[str, Any]) -> None:
            query = self.peer.held()[0]
            self.peer.forget(query)
            said = callback(Message(request), response())
            reply(query, self.peer.message(response.interface).write(said.__dict__))

        self.peer.serve(self.resolve_topic_name(name), kind.interface, answer)

    def create_client(self, kind: Any, name: str) -> _Client:
        return _Client(self, kind, self.resolve_topic_name(name))

    def create_publisher(self, kind: Any, name: str, depth: int) -> _Publisher:
        return _Publisher(self, kind, self.resolve_topic_name(name), depth)

    def create_timer(self, _: float, callback: Callable[[], None]) -> None:
        self.timers.append(callback)

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(each.node.name, each.node.namespace or "/") for each in self.tokens()]

    def get_logger(self) -> _Log:
        return _Log(self._here.logged)

    def tokens(self) -> list[Any]:
        """Return what is announced on the network."""
        keys = self._here.session.liveliness().get(f"@ros2_lv/{_DOMAIN}/**")
        read = [read_token(str(each.ok.key_expr)) for each in keys if each.ok is not None]
        return [each for each in read if each is not None]

    def graph(self) -> set[tuple[Entity, str]]:
        """Return the endpoints that are announced."""
        return {(each.kind, each.topic) for each in self.tokens()}

    def resolve_topic_name(self, name: str) -> str:
        """Return a name with its namespace."""
        return name if name.startswith("/") else f"{self._here.namespace}/{name}"

    resolve_service_name = resolve_topic_name


class LaunchDescription:
    """`launch.LaunchDescription`."""

    def __init__(self, entities: list[Any]) -> None:
        self.entities = entities

    def add_action(self, action: Any) -> None:
        self.entities.append(action)


class LaunchConfiguration(msgspec.Struct, frozen=True):
    """`launch.substitutions.LaunchConfiguration`."""

    name: str


class IfCondition(msgspec.Struct, frozen=True):
    """`launch.conditions.IfCondition`."""

    predicate: Any


class DeclareLaunchArgument:
    """`launch.actions.DeclareLaunchArgument`."""

    def __init__(
        self, name: str, *, default_value: str | None = None, description: str = ""
    ) -> None:
        assert default_value is None or isinstance(default_value, str)
        self.name, self.default, self.description = name, default_value, description


class ExecuteProcess:
    """`launch.actions.ExecuteProcess`."""

    def __init__(
        self, *, cmd: list[Any], name: str, output: str, additional_env: dict[str, str],
        respawn: bool, respawn_delay: float,
    ) -> None:  # fmt: skip
        self.cmd, self.name, self.environment = cmd, name, additional_env
        self.respawn = respawn and respawn_delay > 0
        assert output in ("screen", "log")


class LaunchNode:
    """`launch_ros.actions.Node`."""

    def __init__(
        self, *, package: str, executable: str, namespace: Any = None, parameters: Any = (),
        arguments: Any = (), output: str = "log", respawn: bool = False,
        respawn_delay: float | None = None, condition: IfCondition | None = None,
    ) -> None:  # fmt: skip
        self.package, self.executable, self.namespace = package, executable, namespace
        self.parameters, self.arguments, self.condition = parameters, arguments, condition
        self.respawn = respawn and respawn_delay is not None
        assert output in ("screen", "log")


def modules(share: str) -> dict[str, ModuleType]:
    """Return the modules by name; the package is installed at `share`."""
    contents: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.executors": {"ExternalShutdownException": type("External", (Exception,), {})},
        "rclpy.node": {"Node": Node},
        "rosidl_runtime_py": {},
        "rosidl_runtime_py.set_message": {"set_message_fields": set_message_fields},
        "rosidl_runtime_py.utilities": {"get_message": get_message, "get_service": get_service},
        "std_srvs": {},
        "std_srvs.srv": {"Trigger": get_service("std_srvs/srv/Trigger")},
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_share_directory": lambda _: share},
        "launch": {"LaunchDescription": LaunchDescription},
        "launch.actions": {
            "DeclareLaunchArgument": DeclareLaunchArgument, "ExecuteProcess": ExecuteProcess,
        },
        "launch.conditions": {"IfCondition": IfCondition},
        "launch.substitutions": {"LaunchConfiguration": LaunchConfiguration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": LaunchNode},
    }  # fmt: skip
    made: dict[str, ModuleType] = {}
    for name, content in contents.items():
        made[name] = ModuleType(name)
        made[name].__dict__.update(content)
    return made


class Placed:
    """The next nodes start here."""

    def __init__(self, here: Here) -> None:
        self._here = here

    def __enter__(self) -> Here:
        _here.append(self._here)
        return self._here

    def __exit__(self, *_: object) -> None:
        _here.pop()
