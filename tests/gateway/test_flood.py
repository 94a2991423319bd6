"""A flood, a stalled loop and a slow subscriber cost as much memory as the streams' depths say."""

import asyncio
import threading
import tracemalloc
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Any

import zenoh

from tests.gateway.networks import LIMIT_S, Channel, hear, local_network, matched, run, zenoh_config
from zacoustic.core.values.encoding import LARGEST_VALUE_BYTES
from zacoustic.run.inbox import WakeUp
from zacoustic.zenoh.gateway.dialect.lastvalues import LastValue, LastValues
from zacoustic.zenoh.gateway.dialect.mailbox import PARCEL_OVERHEAD_BYTES, Mailbox, Parcel
from zacoustic.zenoh.gateway.inputerrors import InputErrors

Count = Callable[[int], int]


def parcel(key: str, number: int, payload: bytes = b"") -> Parcel:
    return Parcel(key, payload, "zenoh/bytes", False, number)


def test_mailbox_keeps_the_newest_of_each_key_in_the_order_of_arrival(count: Count) -> None:
    mailbox = Mailbox(2)
    total = count(1_000_000)
    for number in range(total):
        mailbox.post(parcel(f"key/{number % 3}", number))
    assert len(mailbox) == 6
    assert [each.arrived_at for each in mailbox.take()] == list(range(total - 6, total))
    assert (len(mailbox), mailbox.superseded) == (0, total - 6)
    assert mailbox.take() == []


def test_mailbox_is_bounded_whatever_the_keys_and_payloads(count: Count) -> None:
    limit_bytes = 100 * PARCEL_OVERHEAD_BYTES
    mailbox = Mailbox(1000, limit_bytes=limit_bytes)
    total = count(1_000_000)
    for number in range(total):
        mailbox.post(parcel(f"key/{number}", number, bytes(number % 50)))
    kept = mailbox.take()
    assert 50 < len(kept) < 100
    assert kept[-1].key == f"key/{total - 1}"
    mailbox.post(parcel("key", 0, bytes(LARGEST_VALUE_BYTES + 1)))
    assert (len(mailbox), mailbox.oversized) == (0, 1)


def test_wake_up_calls_the_loop_once_for_any_number_of_rings(count: Count) -> None:
    answers = []

    async def main() -> None:
        loop: Any = asyncio.get_running_loop()
        wake_up = WakeUp(loop, lambda: answers.append(len(loop._ready)))
        before = len(loop._ready)
        for _ in range(count(100_000)):
            wake_up.ring()
        assert len(loop._ready) == before + 1
        await asyncio.get_running_loop().run_in_executor(None, wake_up.ring)

    run(main())
    assert len(answers) in (1, 2)
    closed = asyncio.new_event_loop()
    closed.close()
    WakeUp(closed, lambda: None).ring()


def test_last_values_are_bounded(count: Count) -> None:
    values = LastValues(limit=100)
    total = count(100_000)
    for number in range(total):
        values.keep(
            LastValue(
                key=f"key/{number}",
                stream_id=1,
                payload=b"",
                encoding="",
                source=2,
                age_s=None,
                received_at=0,
            )
        )
    assert len(values) == 100
    assert values.of(1)[-1].key == f"key/{total - 1}"
    values.forget(f"key/{total - 1}")
    assert len(values.of(1)) == 99


def test_problems_are_counted_always_and_said_now_and_then(caplog: Any) -> None:
    now = 0
    input_errors = InputErrors(lambda: now, quiet_s=10)
    for _ in range(5):
        input_errors.add("auv1/nav", "payload", "wrong\nunit")
    now = 10_000_000_000
    input_errors.add("auv1/nav", "payload", "auv1/nav: wrong again")
    assert input_errors.counts == {"auv1/nav": {"payload": 6}}
    assert caplog.messages == [
        "auv1/nav: wrong unit",
        "auv1/nav: wrong again (and 4 more since the last warning)",
    ]


def test_stalled_loop_keeps_the_newest_samples_and_one_wake_up(count: Count) -> None:
    total = count(100_000)

    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            a = await stack.enter_async_context(local_network(1, channel))
            b = await stack.enter_async_context(local_network(2, channel))
            shore, auv = stack.enter_context(a.client()), stack.enter_context(b.client())
            await matched(shore, "chat")
            heard = await hear(auv, "chat")
            tracemalloc.start()
            flood(a.port, "chat", total)
            # The loop has stood still, and Zenoh's threads have not.
            loop: Any = asyncio.get_running_loop()
            waiting = len(loop._ready) + len(loop._selector.get_map())
            used, _ = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            assert waiting < 50
            assert used < 4_000_000
            while await heard.payload() != str(total - 1).encode():
                pass
            assert len(heard.samples) <= total

    run(main(), limit_s=300)


def flood(port: int, key: str, total: int) -> None:
    """Put samples from a thread, as fast as it goes, while the caller stands still."""

    def put() -> None:
        with zenoh.open(zenoh_config("client", connect=port)) as session:
            publisher = session.declare_publisher(
                key, congestion_control=zenoh.CongestionControl.BLOCK
            )
            for number in range(total):
                publisher.put(str(number))
            # Answered by the router, which does not stand still, behind all of the above.
            limit_s = LIMIT_S + total / 5_000
            assert len(list(session.liveliness().get("@acoustic/1/gateway", timeout=limit_s))) == 1

    thread = threading.Thread(target=put)
    thread.start()
    thread.join()


def test_flood_reaches_the_other_local_network_with_its_newest_sample(count: Count) -> None:
    total = count(500_000)

    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            a = await stack.enter_async_context(local_network(1, channel))
            b = await stack.enter_async_context(local_network(2, channel))
            shore, auv = stack.enter_context(a.client()), stack.enter_context(b.client())
            await matched(shore, "auv1/text")
            heard = await hear(auv, "auv1/text")
            loop = asyncio.get_running_loop()
            await loop.run_in_executor(None, flood, a.port, "auv1/text", total)
            while await heard.payload() != str(total - 1).encode():
                pass
            numbers = [int(sample.payload.to_bytes()) for sample in heard.samples]
            assert numbers == sorted(numbers)

    run(main(), limit_s=300)


def test_subscriber_that_stands_still_does_not_stop_the_gateway(count: Count) -> None:
    total = count(20_000)
    go_on = threading.Event()

    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            a = await stack.enter_async_context(local_network(1, channel))
            b = await stack.enter_async_context(local_network(2, channel))
            slow, quick = stack.enter_context(b.client()), stack.enter_context(b.client())
            shore = stack.enter_context(a.client())
            stack.callback(go_on.set)
            slow.declare_subscriber("auv1/text", lambda _: bool(go_on.wait(LIMIT_S)) and None)
            heard = await hear(quick, "auv1/text")
            await matched(shore, "auv1/text")
            for number in range(total):
                payload = str(number).encode().ljust(400)
                shore.put("auv1/text", payload)
                if number % 4 == 3:  # its depth: none is superseded
                    while await heard.payload() != payload:
                        pass

    run(main(), limit_s=600)
