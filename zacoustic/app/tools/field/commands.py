"""Remote commands of the command line: local gateways execute or forward them."""

from collections.abc import Sequence

import msgspec

from zacoustic.config import Config
from zacoustic.core.engine.events import CallFailure
from zacoustic.core.streams.commands import RemoteCommand
from zacoustic.errors import CallTimeoutError, DeliveryError, ServiceError
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.session.asking.commandquery import CommandQuery
from zacoustic.zenoh.session.asking.commands import SilenceState, StreamState
from zacoustic.zenoh.session.session import ZenohSession


async def give_command(
    config: Config | None,
    connect: Sequence[str] | None,
    command: RemoteCommand,
    *,
    node: int | None,
    timeout_s: float,
) -> list[SilenceState | StreamState]:
    """Send a command to a local or remote node, and wait for the answer.

    Args:
        config: Names the router, or None.
        connect: Endpoints of the router; override the config.
        command: The query or the command.
        node: Acoustic address; None: the nodes of all local gateways.
        timeout_s: Time limit, s.

    Returns:
        The resulting state of each node, by address.

    Raises:
        SessionError: No router can be reached.
        ServiceError: The node refuses it, with a reason.
        DeliveryError: The node cannot execute it, or no gateway knows the node.
        CallTimeoutError: No answer in time.
    """
    zenoh_session = await ZenohSession.open(session_config(config, connect))
    try:
        question = CommandQuery(node, command, timeout_s)
        await question.ask(zenoh_session)
    finally:
        await zenoh_session.close()
    if question.payloads:
        kind: type[SilenceState] | type[StreamState]
        kind = SilenceState if command.stream_id is None else StreamState
        states = [msgspec.json.decode(payload, type=kind) for payload in question.payloads]
        return sorted(states, key=lambda state: state.address)
    if question.failures:
        raise _error(*question.failures[0], node)
    which = "no gateway is" if node is None else f"no gateway that knows node {node} is"
    raise DeliveryError(
        f"{which} on this local network", hint="is it running, and is --connect its router?"
    )


def _error(failure: CallFailure, text: str, node: int | None) -> DeliveryError | ServiceError:
    if failure is CallFailure.TIMED_OUT:
        return CallTimeoutError(text)
    if failure is CallFailure.HANDLER:
        return ServiceError(f"refused by node {node}: {text}")
    return DeliveryError(text)
