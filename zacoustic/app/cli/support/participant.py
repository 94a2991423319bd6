"""The common part of verbs that take part, on Zenoh or directly on a link; values of streams."""

import contextlib
from typing import TYPE_CHECKING, Any, TypeVar

from zacoustic.app.cli.support.rows import OBJECT_PER_LINE, endpoint, flag, option, whole
from zacoustic.app.cli.support.verb import FleetVerb
from zacoustic.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from zacoustic.app.tools.field.asking import Gateways
    from zacoustic.config import Config
    from zacoustic.core.streams.table import Stream
    from zacoustic.core.values.types import TypeSpec
    from zacoustic.zenoh.node import Node

T = TypeVar("T")


class Participant(FleetVerb):
    """A verb that takes part: on Zenoh, or directly on a link."""

    connect: list[str] | None = endpoint(either="where")
    link: str | None = option("LOCATOR", "straight on a link; needs --config", either="where")
    config: str | None = option("FILE", "file with the section plugins.acoustic")
    address: int | None = whole("N", "acoustic address, instead of the file's")
    json: bool = flag(OBJECT_PER_LINE)

    def make_node(self) -> "Node":
        """Make the node that the arguments describe; it is not open yet.

        Raises:
            ConfigError: A link without a config.
        """
        from zacoustic.zenoh.node import Node

        if self.link is not None and self.config is None:
            raise ConfigError("--link needs --config FILE, which has the stream ids")
        return Node(
            "command line",
            config=self.config,
            link=self.link,
            connect=self.connect,
            address=self.address,
        )

    @contextlib.asynccontextmanager
    async def way(
        self,
        config: "Config | None",
        by_gateways: "Callable[[Gateways], T]",
        by_link: "Callable[[Node], T]",
    ) -> "AsyncIterator[T]":
        """Open the way to other nodes, through the gateways here or through a node of its own.

        Args:
            config: As read.
            by_gateways: Makes the object that asks the gateways.
            by_link: Makes the object that asks on the link.

        Raises:
            SessionError, LinkError: There is no way.
        """
        from zacoustic.app.tools.field.asking import local_gateways

        if self.link is None:
            async with local_gateways(config, self.connect) as gateways:
                yield by_gateways(gateways)
        else:
            async with self.make_node() as own:
                yield by_link(own)

    def print_value(self, record: dict[str, Any], value: object, told: str = "{}") -> None:
        """Print a value, for people in a line of its own.

        Args:
            record: Further members of the JSON object.
            value: The value.
            told: The line for people, with a place for the value.
        """
        from zacoustic.zenoh.node.api.text import line_of, shown_value

        shown = shown_value(value, "")
        self.line({**record, **shown}, told.replace("{}", line_of(shown)))


def class_of(spec: "TypeSpec | None") -> type[bytes] | str:
    """Return the type argument of an endpoint: a name, or bytes without a type."""
    return bytes if spec is None else spec.name


def read_request(stream: "Stream", text: str, *, source: str) -> Any:  # noqa: ANN401 (of its type)
    """Read the request of a service or the goal of an action; empty: all fields have defaults.

    Args:
        stream: The service or the action.
        text: The text of the user.
        source: The argument, for errors.

    Raises:
        ConfigError: The type has no such value.
    """
    from zacoustic.zenoh.node.api.text import read_text

    return read_text(text or ("{}" if stream.type is not None else ""), stream.type, source=source)
