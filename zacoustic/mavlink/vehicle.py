"""The bridge beside the autopilot: serves the commands, publishes HIGH_LATENCY2."""

import asyncio
import itertools
from functools import partial
from typing import Any

from zacoustic.core.base.clock import Clock
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.mavlink.autopilot import AutopilotSide, answer_value
from zacoustic.mavlink.bridge import Bridge, Settings, Tell
from zacoustic.mavlink.commands import Answer
from zacoustic.mavlink.entries import (
    GROUND,
    SERVICES,
    TELEMETRY,
    Names,
    ground_addresses,
)
from zacoustic.mavlink.outputs import Call, Publish, Reply
from zacoustic.zenoh.node import CallContext, Node, Publisher, Sample


class VehicleBridge(Bridge):
    """Joins the autopilot to the vehicle's gateway.

    Args:
        engine: Its rules.
        settings: What it is connected to.
        names: The streams.
        tell: Takes notices.
        clock: Source of instants, ns; none: that of the system.
    """

    def __init__(
        self,
        engine: AutopilotSide,
        settings: Settings,
        names: Names,
        tell: Tell,
        **clock: Clock,
    ) -> None:
        super().__init__(engine, settings, tell, **clock)
        self._side = engine
        self._names = names
        self._shores = ground_addresses(names)
        self._numbers = itertools.count()
        self._waiting: dict[int, asyncio.Future[Answer]] = {}
        self._telemetry: Publisher[Any] | None = None

    def _begin(self, node: Node, tasks: asyncio.TaskGroup) -> None:
        names = self._names
        self._telemetry = node.create_publisher(names.type_of(TELEMETRY), names.of(TELEMETRY))
        node.create_subscription(names.type_of(GROUND), names.of(GROUND), self._hear)
        for name in SERVICES:
            types = (names.type_of(name), names.answer_of(name))
            node.create_service(types, names.of(name), partial(self._serve, name))

    def _do(self, output: Publish | Call | Reply) -> None:
        if isinstance(output, Publish):
            assert self._telemetry is not None
            self._telemetry.publish(output.value)
        elif isinstance(output, Reply):
            answer = self._waiting.pop(output.number)
            if not answer.done():
                answer.set_result(output.answer)

    def _hear(self, sample: Sample[Any]) -> None:
        if not sample.deleted:
            self.put(self._side.handle_ground)

    async def _serve(
        self, service: str, request: dict[str, Any], context: CallContext
    ) -> dict[str, Any]:
        number = next(self._numbers)
        answer = self._waiting[number] = asyncio.get_running_loop().create_future()
        # Not any caller: the gateway of the vehicle calls as well (`lost_contact`).
        is_shore = context.client in self._shores
        spec = self._names.streams[service].spec
        assert isinstance(spec, ServiceSpec)
        self.put(
            lambda now: self._side.handle_request(
                number,
                service,
                request,
                context.client,
                now,
                timeout_s=spec.timeout_s,
                is_shore=is_shore,
            )
        )
        return answer_value(await answer)


def vehicle_address(names: Names) -> int:
    """Return the address of the node whose gateway is on the vehicle."""
    spec = names.streams[SERVICES[0]].spec
    assert isinstance(spec, ServiceSpec)
    return spec.server
