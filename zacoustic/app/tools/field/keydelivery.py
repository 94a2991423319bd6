"""Delivers a key for broadcasts to one node through the local gateway."""

from collections.abc import Sequence

import msgspec

from zacoustic.app.tools.field.asking import ask_gateway
from zacoustic.config import Config
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.session.asking.keydelivery import KeyAnswer, delivery_selector
from zacoustic.zenoh.session.session import ZenohSession


async def deliver_key(
    config: Config | None,
    connect: Sequence[str] | None,
    *,
    node: int,
    source: int,
    timeout_s: float,
) -> KeyAnswer:
    """Send a node the key for a source's broadcasts, and wait for its answer.

    Args:
        config: Names the router, or None.
        connect: Endpoints of the router; override the config.
        node: Address of the receiving node.
        source: The node whose broadcasts it is to open.
        timeout_s: Time limit, s.

    Raises:
        SessionError: No router can be reached.
        ServiceError: The node refuses the key, with a reason.
        DeliveryError: The gateway does not have the key, or no gateway knows the node.
        CallTimeoutError: No answer in time.
    """
    key, parameters = delivery_selector(node, source, timeout_s)
    zenoh_session = await ZenohSession.open(session_config(config, connect))
    try:
        answer = await ask_gateway(zenoh_session, key, parameters, node=node, timeout_s=timeout_s)
    finally:
        await zenoh_session.close()
    return msgspec.json.decode(answer, type=KeyAnswer)
