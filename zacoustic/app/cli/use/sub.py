"""The verb `zacoustic topic echo`."""

import asyncio
import contextlib
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final

from zacoustic.app.cli.support.participant import Participant, class_of
from zacoustic.app.cli.support.rows import seconds, whole, word
from zacoustic.link.command import EXIT_OK, EXIT_TIMED_OUT

if TYPE_CHECKING:
    from zacoustic.zenoh.node import Node, Sample

# Samples of each key that may wait while standard output is blocked.
_DEPTH: Final = 1024


class Echo(Participant):
    """Print the samples of a topic, on Zenoh or straight on a link.

    Examples:
      zacoustic topic echo auv1/nav --connect tcp/127.0.0.1:7447
      zacoustic topic echo --link sim/127.0.0.1:7000 --config fleet.json5 --count 1 --timeout 60 --json
    """  # noqa: E501 (wide on a terminal)

    key: str | None = word("KEY", "topic of the config, or key expression; none: all topics", "?")
    count: int | None = whole("N", "end after N samples", least=1)
    timeout: float | None = seconds(
        "end after this time, s; exit code 3 with fewer samples than --count or none"
    )
    runs_on = True

    async def work(self) -> int:
        """Print until the number is reached, the time is over, or Ctrl-C."""
        from zacoustic.zenoh.node.api.mailbox import Mailbox

        wanted, seen = self.count or 1, 0
        async with self.make_node() as node:
            # Printed here, not in callbacks, so that a reader that closes the pipe ends the verb.
            arrived: Mailbox[Sample[Any]] = Mailbox(_DEPTH)
            subscribe(node, self._keys(node), lambda sample: arrived.put(sample, sample.key))
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self.timeout):
                    while self.count is None or seen < wanted:
                        sample = await arrived.get()
                        assert sample is not None
                        self._print(sample)
                        seen += 1
        if seen >= wanted:
            return EXIT_OK
        self.note(f"{seen} of {wanted} samples within {self.timeout:g} s")
        return EXIT_TIMED_OUT

    def _keys(self, node: "Node") -> list[str]:
        """Return the keys to subscribe to: the given one, all topics, without a config all keys."""
        if self.key is not None:
            return [self.key]
        names = node.topics()
        told = ", ".join(names) if names else "every key"
        self.note(f"listening to {told}")
        return names or ["**"]

    def _print(self, sample: "Sample[Any]") -> None:
        from zacoustic.core.values.age import age_words
        from zacoustic.zenoh.node.api.text import line_of, shown_value

        shown = {} if sample.deleted else shown_value(sample.content, sample.encoding)
        notes = [f"from {sample.source}"] if sample.source is not None else []
        age_s = sample.age_s
        if age_s is not None:  # a latched one may have waited here
            age_s = round(age_s + (time.monotonic_ns() - sample.received_at) / 1e9, 3)
            notes += [age_words(age_s, sample.age_error_s)]
        note = f"  ({', '.join(notes)})" if notes else ""
        record = {
            "key": sample.key,
            **shown,
            "deleted": sample.deleted,
            "encoding": sample.encoding,
            "source": sample.source,
            "age_s": age_s,
            "age_error_s": sample.age_error_s,
            "unix_s": time.time(),
        }
        self.line(record, f"{sample.key}: {'deleted' if sample.deleted else line_of(shown)}{note}")


def subscribe(node: "Node", keys: Iterable[str], take: "Callable[[Sample[Any]], None]") -> None:
    """Subscribe to keys."""
    from zacoustic.core.base.qos import Qos

    for name in keys:
        stream = node.find_stream(name)
        sample_type: Any = class_of(None if stream is None else stream.type)
        node.create_subscription(sample_type, name, take, Qos(depth=_DEPTH))
