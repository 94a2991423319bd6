"""The bridge beside the ground station: calls the commands, shows what has crossed."""

import asyncio
from functools import partial
from typing import Any

from zacoustic.core.base.clock import Clock
from zacoustic.errors import (
    CallTimeoutError,
    ConfigError,
    DeliveryError,
    OutcomeUnknownError,
    PayloadInvalidError,
    PayloadTooLargeError,
    QueueFullError,
    ZacousticError,
)
from zacoustic.mavlink.bridge import Bridge, Settings, Tell
from zacoustic.mavlink.commands import Answer
from zacoustic.mavlink.entries import GROUND, SERVICES, TELEMETRY, Names, ground_addresses
from zacoustic.mavlink.outputs import Call, Publish, Reply
from zacoustic.mavlink.station import StationSide
from zacoustic.zenoh.node import Client, Node, Publisher, Sample


class ShoreBridge(Bridge):
    """Joins a ground station to the gateway on shore.

    Args:
        engine: Its rules.
        settings: What it is connected to.
        names: The streams.
        tell: Takes notices.
        clock: Source of instants, ns; none: that of the system.
    """

    def __init__(
        self,
        engine: StationSide,
        settings: Settings,
        names: Names,
        tell: Tell,
        **clock: Clock,
    ) -> None:
        super().__init__(engine, settings, tell, **clock)
        self._side = engine
        self._names = names
        self._ground: Publisher[Any] | None = None
        self._clients: dict[str, Client[Any, Any]] = {}
        self._tasks: asyncio.TaskGroup | None = None

    def _begin(self, node: Node, tasks: asyncio.TaskGroup) -> None:
        names = self._names
        self._tasks = tasks
        self._ground = node.create_publisher(names.type_of(GROUND), names.of(GROUND))
        node.create_subscription(names.type_of(TELEMETRY), names.of(TELEMETRY), self._show)
        for name in SERVICES:
            types = (names.type_of(name), names.answer_of(name))
            self._clients[name] = node.create_client(types, names.of(name))

    def _do(self, output: Publish | Call | Reply) -> None:
        if isinstance(output, Publish):
            assert self._ground is not None
            self._ground.publish(output.value)
        elif isinstance(output, Call):
            assert self._tasks is not None
            self._tasks.create_task(self._call(output))

    def _show(self, sample: Sample[Any]) -> None:
        if sample.content is not None:
            self.put(partial(self._side.handle_telemetry, sample.content, sample.age_s))

    async def _call(self, call: Call) -> None:
        try:
            answer = answer_of(await self._clients[call.service].call(call.value))
        except ZacousticError as error:
            answer = answer_of_error(error)
        self.put(partial(self._side.handle_answer, call.number, answer))


def answer_of(value: dict[str, Any]) -> Answer:
    """Return the answer that has crossed."""
    return Answer(value["result"], value.get("text") or "")


def answer_of_error(error: ZacousticError) -> Answer:
    """Return the answer for a call that has failed: was the command executed?"""
    text = " ".join(str(error.args[0]).split())
    match error:
        case CallTimeoutError() | OutcomeUnknownError():
            return Answer("no_answer", "no answer in time; it may have been done")
        case PayloadInvalidError() | PayloadTooLargeError():
            return Answer("denied", text)
        case DeliveryError() | QueueFullError():  # it was not sent, or nobody serves there
            return Answer("temporarily_rejected", text.partition(": ")[2] or text)
        case _:
            return Answer("failed", text)


def shore_address(names: Names) -> int:
    """Return the address of the node whose gateway is on shore.

    Raises:
        ConfigError: Several nodes may say that a ground station is there.
    """
    publishers = ground_addresses(names)
    if len(publishers) != 1:
        raise ConfigError(
            f"stream {names.of(GROUND)}: {len(publishers)} publishers; allowed: one, the shore"
        )
    return publishers[0]
