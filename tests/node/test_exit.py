"""A script that ends without closing its node ends, with the exit code of its own."""

import asyncio
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

from tests.gateway.networks import run, zenoh_config
from tests.node.fleet import ChannelServer, router
from zacoustic.core.base.qos import Priority
from zacoustic.zenoh.session.asking.question import Question
from zacoustic.zenoh.session.session import ZenohSession

ROOT: Final = Path(__file__).parents[2]
LIMIT_S: Final = 5.0
"""Time from the end of the script to the end of the process, s."""
LONG_S: Final = 600.0

SCRIPT: Final = """
import asyncio, sys, threading, time
import zacoustic
from zacoustic import Node, blocking

where = dict({where!r})


def callback(sample):
    pass


def use(node):
    node.create_subscription(bytes, "note", callback, {stream_id})
    node.create_publisher(bytes, "note").publish(b"x")
    {serve}


def scripted():
    node = blocking.Node(1, **where)
    node.open()
    use(node)
    return node


async def asynchronous():
    node = Node(1, **where)
    await node.open()
    use(node)
    served = {{"stream_id": 21, "server": 2}} if "link" in where else {{}}
    client = node.create_client((bytes, bytes), "other", **served)
    call = asyncio.ensure_future(client.call(b"x", timeout_s=600))
    await asyncio.sleep(0)
    print("end", time.time(), flush=True)
    {end}


if {is_blocking}:
    node = scripted()
    print("end", time.time(), flush=True)
    {end}
else:
    asyncio.run(asynchronous())
"""


@contextmanager
def somewhere(mode: str) -> Iterator[dict[str, str]]:
    if mode == "link":
        with ChannelServer() as locator:
            yield {"link": locator}
    else:
        with router() as (endpoint, session):
            stop = threading.Event()

            def talk() -> None:
                """Put samples all the time: the threads that take them are to be in motion."""
                while not stop.wait(0.002):
                    session.put("note", b"y")

            talking = threading.Thread(target=talk)
            talking.start()
            try:
                yield {"connect": endpoint}
            finally:
                stop.set()
                talking.join()


@pytest.mark.parametrize("mode", ["link", "zenoh"])
@pytest.mark.parametrize("is_blocking", [False, True])
@pytest.mark.parametrize(
    ("end", "code"), [("raise ValueError('a bug')", 1), ("sys.exit(7)", 7), ("pass", 0)]
)
def test_a_script_that_does_not_close_its_node_ends(
    mode: str, is_blocking: bool, end: str, code: int
) -> None:
    with somewhere(mode) as where:
        script = SCRIPT.format(
            where=where,
            stream_id="stream_id=10" if mode == "link" else "None",
            serve="" if mode == "link" else 'node.create_service((bytes, bytes), "echo", bytes)',
            is_blocking=is_blocking,
            end=end,
        )
        process = subprocess.run(
            [sys.executable, "-c", script],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        ended_at = time.time()
    assert process.returncode == code, process.stderr
    word, said_at = process.stdout.split()
    assert word == "end"
    assert ended_at - float(said_at) < LIMIT_S
    assert ("ValueError: a bug" in process.stderr) is (code == 1)
    assert "Aborted" not in process.stderr


def test_a_call_for_which_no_thread_starts_any_more_is_settled_and_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From Python 3.12 on, an ending interpreter starts none; the call may just be on its way."""

    def refuse(_: threading.Thread) -> None:
        raise RuntimeError("can't create new thread at interpreter shutdown")

    async def main() -> None:
        zenoh_session = await ZenohSession.open(zenoh_config("peer"))
        settled: asyncio.Queue[Question] = asyncio.Queue()
        worker = zenoh_session.worker
        try:
            with monkeypatch.context() as ending:
                ending.setattr(threading.Thread, "start", refuse)
                question = Question(
                    zenoh_session,
                    "auv1/echo",
                    settled.put_nowait,
                    b"x",
                    priority=Priority.DATA,
                    timeout_s=LONG_S,
                )
                await worker.run(lambda: None, limit_s=LIMIT_S)
            async with asyncio.timeout(LIMIT_S):
                assert await settled.get() is question
            assert question.good is None
            question.cancel()
            await worker.run(lambda: None, limit_s=LIMIT_S)
        finally:
            await zenoh_session.close()

    run(main())
