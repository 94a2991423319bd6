"""Remote commands of the command line: local gateways execute or forward them."""

from collections.abc import Sequence

import msgspec

from zacoustic.app.tools.field.asking import no_answer
from zacoustic.config import Config
from zacoustic.core.streams.commands import RemoteCommand
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.session.asking.allreplies import ask_all
from zacoustic.zenoh.session.asking.commands import SilenceState, StreamState, selector
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
        key, parameters = selector(node, command, timeout_s)
        replies = await ask_all(zenoh_session, key, parameters, timeout_s=timeout_s)
    finally:
        await zenoh_session.close()
    if replies.answers:
        kind: type[SilenceState] | type[StreamState]
        kind = SilenceState if command.stream_id is None else StreamState
        states = [msgspec.json.decode(payload, type=kind) for _, payload in replies.answers]
        return sorted(states, key=lambda state: state.address)
    raise no_answer(node, next(iter(replies.failures), None))
