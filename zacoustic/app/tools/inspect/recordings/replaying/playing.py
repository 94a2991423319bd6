"""`zacoustic replay`: puts the samples of a recording onto a Zenoh network, in their time."""

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import msgspec
import zenoh

from zacoustic.app.tools.inspect.recordings.replaying.putting import Put, PutReader
from zacoustic.config import Config
from zacoustic.errors import ConfigError
from zacoustic.run.recording.reading import RecordingReader
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.session.session import ZenohSession


class Played(msgspec.Struct, kw_only=True):
    """The result of a replay."""

    samples: dict[str, int]
    """Number of samples, by key."""
    left_out: dict[str, int] = {}
    """Number of samples that could not be put, by key."""
    duration_s: float = 0.0
    """From the first sample of the recording to the last, s."""


async def play(
    path: str | Path,
    *,
    config: Config | None,
    connect: Sequence[str] | None,
    rate: float | None,
    keys: Sequence[str],
    node: int | None,
    stop: asyncio.Event,
    now_s: Callable[[], float] | None = None,
) -> Played:
    """Put the samples of a recording.

    Args:
        path: The file.
        config: Names the router, and the keys of topics of ROS; or None.
        connect: Endpoints of the router; override the config.
        rate: Speed relative to the recording, above 0; None: without waiting.
        keys: Key expressions to select samples; none: all.
        node: Node of the samples, in a recording of several engines.
        stop: Set to end it early.
        now_s: Clock, s; default: the loop's.

    Raises:
        ConfigError: The file, a key or the node is wrong.
        SessionError: No router can be reached.
    """
    wanted = [_expression(key) for key in keys]
    reader = PutReader(node=node, config=config)
    played = Played(samples={})
    clock = now_s or asyncio.get_running_loop().time
    zenoh_session = await ZenohSession.open(session_config(config, connect))
    try:
        first_ns: int | None = None
        began_s = clock()
        for message in RecordingReader(path):
            for put in reader.read(message):
                if wanted and not any(each.includes(zenoh.KeyExpr(put.key)) for each in wanted):
                    continue
                first_ns = put.utc_ns if first_ns is None else first_ns
                played.duration_s = (put.utc_ns - first_ns) / 1e9
                if rate is not None:
                    await _until(began_s + played.duration_s / rate - clock(), stop)
                if stop.is_set():
                    return played
                await zenoh_session.worker.run(partial(_put, zenoh_session, put))
                played.samples[put.key] = played.samples.get(put.key, 0) + 1
    finally:
        played.left_out = reader.left_out
        await zenoh_session.close()
    if not played.samples and not played.left_out:
        raise ConfigError(f"{path}: no sample of {', '.join(keys) or 'any key'} is in it")
    return played


def _put(zenoh_session: ZenohSession, put: Put) -> None:
    """Put a sample, in the worker: nothing is dropped on a slow network."""
    blocks = zenoh.CongestionControl.BLOCK
    if put.deleted:
        zenoh_session.session.delete(put.key, attachment=put.attachment, congestion_control=blocks)
    else:
        zenoh_session.session.put(
            put.key,
            put.payload,
            encoding=put.encoding,
            attachment=put.attachment,
            congestion_control=blocks,
        )


async def _until(delay_s: float, stop: asyncio.Event) -> None:
    if delay_s > 0:
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), delay_s)


def _expression(key: str) -> zenoh.KeyExpr:
    try:
        return zenoh.KeyExpr(key)
    except zenoh.ZError as error:
        raise ConfigError(f'--key "{key}"; allowed: a key expression, such as auv1/**') from error
