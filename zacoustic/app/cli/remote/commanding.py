"""The common part of verbs that command a node."""

from typing import TYPE_CHECKING, Any, Final

import msgspec

from zacoustic.app.cli.support.rows import (
    OBJECT_PER_LINE,
    check_within,
    flag,
    node_address,
    seconds,
)
from zacoustic.app.cli.support.verb import NetworkVerb
from zacoustic.core.base.clock import SHORTEST_S
from zacoustic.errors import ConfigError

if TYPE_CHECKING:
    from zacoustic.core.streams.commands import RemoteCommand

_HERE_S: Final = 10.0
_BEYOND_S: Final = 60.0
NODE: Final = "acoustic address of the node, of this local network or remote"


class Commanding(NetworkVerb):
    """A verb that commands a node, of this network or remote, or all gateways here."""

    node: int | None = node_address(f"{NODE} (default: those of all gateways here)")
    timeout: float | None = seconds(
        f"how long to try, s (default: {_BEYOND_S:g} for one node, else {_HERE_S:g})"
    )
    json: bool = flag(OBJECT_PER_LINE)

    async def give(self, command: "RemoteCommand") -> None:
        """Send a command and print the new state.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, ServiceError: There is no such node, or it refuses.
            CallTimeoutError: No answer comes in time.
        """
        from zacoustic.app.tools.field.asking import local_gateways
        from zacoustic.zenoh.requests.commands import row_of

        request = row_of(command)
        timeout_s = self.timeout or (_HERE_S if self.node is None else _BEYOND_S)
        check_within("--timeout", timeout_s, SHORTEST_S, request.most_s, unit=" s")
        async with local_gateways(self.fleet(), self.connect) as gateways:
            if self.node is None:
                states: list[Any] = await gateways.ask_all(request, command, timeout_s)
            else:
                states = [await gateways.ask(request, self.node, command, timeout_s)]
        for state in sorted(states, key=lambda state: state.address):
            self.line(msgspec.to_builtins(state), state.text())


def make_command(**fields: Any) -> "RemoteCommand":  # noqa: ANN401 (fields of a command)
    """Make a command.

    Raises:
        ConfigError: The fields contradict each other.
    """
    from zacoustic.core.streams.commands import RemoteCommand

    try:
        return RemoteCommand(**fields)
    except ValueError as error:
        raise ConfigError(str(error)) from None
