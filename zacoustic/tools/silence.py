"""Orders of silence: asks the gateways of this island, which do it."""

import asyncio
from collections.abc import Sequence

import msgspec

from zacoustic.config import Config
from zacoustic.errors import DeliveryError
from zacoustic.gateway.silence import SilenceState
from zacoustic.island.doorbell import tell_loop
from zacoustic.island.session import Island
from zacoustic.node.session import session_config


async def ask_silence(
    config: Config | None,
    connect: Sequence[str] | None,
    *,
    address: int | None,
    order: str | None = None,
    for_s: float | None = None,
    timeout_s: float,
) -> list[SilenceState]:
    """Ask gateways of this island to be silent, to go on, or what holds.

    Args:
        config: Tells where the router is, or None.
        connect: Endpoints of the router, instead of those.
        address: Of the gateway; None: all that are there.
        order: ``begin``, ``resume``, or None: only ask.
        for_s: How long, s; None: until it is resumed.
        timeout_s: How long to wait for answers, s.

    Returns:
        What each of them says, by address.

    Raises:
        SessionError: No router is reached.
        DeliveryError: A gateway refuses, or none is there.
        TimeoutError: No answer in time.
    """
    words = [f"order={order}"] if order else []
    words += [f"for_s={for_s:g}"] if for_s is not None else []
    where = f"@acoustic/{'*' if address is None else address}/silence"
    island = await Island.open(session_config(config, connect))
    try:
        question = _Question(asyncio.get_running_loop())
        await island.worker.run(
            lambda: question.ask(island, where, ";".join(words), timeout_s=timeout_s)
        )
        await question.ended
    finally:
        await island.close()
    if question.refused:
        raise DeliveryError(question.refused[0])
    if not question.states:
        if question.timed_out:
            raise TimeoutError(f"no answer from {where} within {timeout_s:g} s")
        which = "no gateway" if address is None else f"no gateway with address {address}"
        raise DeliveryError(
            f"{which} is on this island",
            hint="orders over the water are not available yet: ask on the island of that node"
            if address is not None
            else "is it running, and is --connect its router?",
        )
    return sorted(question.states, key=lambda state: state.address)


class _Question:
    """One `get` and its replies, which come on threads of Zenoh's."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.states: list[SilenceState] = []
        self.refused: list[str] = []
        self.timed_out = False
        self.ended: asyncio.Future[None] = loop.create_future()
        self._loop = loop

    def ask(self, island: Island, key: str, parameters: str, *, timeout_s: float) -> None:
        """Ask; in the worker."""
        import zenoh

        island.session.get(
            zenoh.Selector(zenoh.KeyExpr(key), parameters or None),
            island.callback(self._take, self._end),
            timeout=timeout_s,
            consolidation=zenoh.ConsolidationMode.NONE,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def _take(self, reply: "object") -> None:
        ok, err = getattr(reply, "ok", None), getattr(reply, "err", None)
        if ok is not None:
            self.states.append(msgspec.json.decode(ok.payload.to_bytes(), type=SilenceState))
        elif err is not None:
            text = err.payload.to_bytes().decode(errors="replace")
            if text == "Timeout":
                self.timed_out = True
            else:
                self.refused.append(" ".join(text.split()))

    def _end(self) -> None:
        tell_loop(self._loop, self._settle)

    def _settle(self) -> None:
        if not self.ended.done():
            self.ended.set_result(None)
