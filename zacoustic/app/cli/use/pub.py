"""The verb `zacoustic topic pub`."""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.participant import Participant, class_of
from zacoustic.app.cli.support.rows import flag, option, real, seconds, whole, word
from zacoustic.errors import ConfigError, DeliveryError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, EXIT_TIMED_OUT

if TYPE_CHECKING:
    from zacoustic.app.cli.support.progress import ProgressLine
    from zacoustic.app.tools.field.following import End, GatewayFollower
    from zacoustic.core.streams.table import Stream
    from zacoustic.zenoh.node import Delivery, Node


class Pub(Participant):
    """Publish a value, on Zenoh or straight on a link.

    Examples:
      zacoustic topic pub auv1/cmd '{ mode: "survey" }' --connect tcp/127.0.0.1:7447
      zacoustic topic pub auv1/cmd '{ mode: "survey" }' --link sim/127.0.0.1:7000 --config fleet.json5
      zacoustic topic pub auv1/map --file map.png --wait --timeout 3600 --connect tcp/127.0.0.1:7447
    """  # noqa: E501 (wide on a terminal)

    key: str = word("KEY", "topic of the config, or key expression")
    value: str | None = word("VALUE", "JSON5 for a typed topic, otherwise a text", "?")
    file: str | None = option("FILE", "instead of VALUE: its bytes, for a topic without a type")
    wait: bool = flag(
        "wait until the last one has arrived everywhere (reliable topics), and show how far it is; "
        "exit code 1 when it ended otherwise"
    )
    rate: float | None = real("HZ", "publish so often; until --count or Ctrl-C")
    count: int | None = whole("N", "publish N times", least=1)
    timeout: float = seconds(
        "how long the last one may take to leave, or with --wait to arrive, s", 60.0
    )
    runs_on = True

    async def work(self) -> int:
        """Publish; on a link, wait until the last value has left.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError: With --wait, no gateway reports whether it has arrived.
        """
        if (self.value is None) == (self.file is None):
            raise ConfigError("VALUE or --file FILE; allowed: one of the two")
        from zacoustic.app.cli.support.progress import ProgressLine
        from zacoustic.app.tools.field.following import shown as followed
        from zacoustic.zenoh.node.api.text import line_of, shown_value

        async with self.make_node() as node, self._follower(node) as follower:
            stream = node.find_stream(self.key)
            sample_type: Any = class_of(None if stream is None else stream.type)
            value, encoding = self._read_value(stream)
            publisher = node.create_publisher(sample_type, self.key)
            shown = shown_value(value, encoding or "")
            if self.file is not None:
                shown = {"file": self.file, "bytes": len(value)}
            delivery: Delivery | None = None
            async for _ in _beats(self.rate, self.count):
                delivery = publisher.publish(value, encoding=encoding)
                record = {"key": publisher.key, **shown, "unix_s": time.time()}
                self.line(record, f"{publisher.key}: {line_of(shown)}")
            try:
                with (
                    AT_WORK.begin(self.program),
                    ProgressLine(publisher.key, as_json=self.json) as line,
                ):
                    async with asyncio.timeout(self.timeout), followed(delivery, line.show):
                        await node.flush()
                        end = await _end(delivery, follower, line) if self.wait else None
                        if end is None and (unsent := _unsent(node, stream, delivery)):
                            self.note(f"{publisher.key}: {unsent}")
                            return EXIT_FAILED
            except TimeoutError:
                what = "arrived" if self.wait else "sent"
                self.note(f"not {what} within {self.timeout:g} s")
                return EXIT_TIMED_OUT
        if end is None:
            return EXIT_OK
        missing = f", missing at {', '.join(map(str, end.missing))}" if end.missing else ""
        detail = f" ({end.detail})" if end.detail else ""
        ending = {"event": "ended", "outcome": end.outcome, "detail": end.detail}
        record = {"key": publisher.key, **ending, "missing": end.missing}
        self.line(record, f"{publisher.key}: {end.outcome}{missing}{detail}")
        return EXIT_OK if end.outcome == "delivered" else EXIT_FAILED

    def _read_value(self, stream: "Stream | None") -> tuple[Any, str | None]:
        """Return the payload, and its encoding if it is not the stream's.

        Raises:
            ConfigError: The value or the file is wrong.
        """
        from zacoustic.zenoh.node.api.text import read_text, read_untyped

        if self.file is not None:
            if stream is not None and stream.type is not None:
                raise ConfigError(
                    f"--file {self.file}: {self.key} has the type {stream.type.name}",
                    hint="give a VALUE",
                )
            try:
                return Path(self.file).read_bytes(), None
            except OSError as error:
                raise ConfigError(f"--file {self.file}: {error.strerror}") from error
        text = self.value or ""
        if stream is None:
            return read_untyped(text, source="VALUE")
        return read_text(text, stream.type, source="VALUE"), None

    @contextlib.asynccontextmanager
    async def _follower(self, node: "Node") -> "AsyncIterator[GatewayFollower | None]":
        """Watch the gateway that forwards a topic, to wait for the outcome on Zenoh."""
        if not self.wait or self.link is not None:
            yield None
            return
        from zacoustic.app.tools.field.following import GatewayFollower
        from zacoustic.app.tools.watch.watching import Watch

        stream = node.find_stream(self.key)
        async with Watch(self.fleet(), self.connect) as watch:
            yield GatewayFollower(watch, self.key if stream is None else stream.name)


def _unsent(node: "Node", stream: "Stream | None", delivery: "Delivery | None") -> str:
    """Return why a sample that no longer waits was not sent; empty: it was."""
    if delivery is not None and delivery.outcome is not None:
        outcome = delivery.outcome.value
        return "" if outcome == "delivered" else f"not delivered: {outcome}"
    expired = 0 if stream is None else node.expired().get(stream.stream_id, 0)
    return f"{expired} became too old before they could be sent" if expired else ""


async def _end(
    delivery: "Delivery | None", follower: "GatewayFollower | None", line: "ProgressLine"
) -> "End":
    """Wait for the end of a sample.

    Raises:
        DeliveryError: No gateway will report it.
    """
    from zacoustic.app.tools.field.following import end_of

    if follower is not None:
        return await follower.end(line.show)
    if delivery is None:
        raise DeliveryError(
            "it is not reliable: nobody learns whether it has arrived",
            hint='reliability: "reliable" in its stream',
        )
    return await end_of(delivery)


async def _beats(rate_hz: float | None, count: int | None) -> AsyncIterator[None]:
    """Tick as often as the arguments say; late ticks are dropped."""
    left = count if count is not None else (1 if rate_hz is None else None)
    loop = asyncio.get_running_loop()
    due_at = loop.time()
    while left is None or left > 0:
        yield
        if left is not None:
            left -= 1
        if rate_hz is not None and left != 0:
            due_at = max(due_at + 1 / rate_hz, loop.time())
            await asyncio.sleep(due_at - loop.time())
