"""What other threads hand to the loop: bounded, in order, with one wake-up."""

import asyncio
from functools import partial

from zacoustic.run.inbox import Inbox, WakeUp, crossing


def test_inbox_refuses_beyond_its_limit_or_keeps_the_newest() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        refusing: Inbox[int] = Inbox(WakeUp(loop, lambda: None), limit=2)
        assert [refusing.put(each) for each in range(4)] == [True, True, False, False]
        assert (refusing.take(), refusing.take()) == ((0, 1), ())
        newest: Inbox[int] = Inbox(WakeUp(loop, lambda: None), limit=2, keeps_newest=True)
        assert all(newest.put(each) for each in range(4))
        assert newest.take() == (2, 3)

    asyncio.run(main())
    closed = asyncio.new_event_loop()
    closed.close()
    assert not Inbox[int](WakeUp(closed, lambda: None), limit=2).put(1)


def test_crossing_brings_the_newest_items_of_a_thread_in_order() -> None:
    async def main() -> None:
        came: list[int] = []
        all_there = asyncio.Event()

        def take(item: int) -> None:
            came.append(item)
            if item == 999:
                all_there.set()

        put = crossing(take, limit=3)
        for item in range(10):  # the loop has no turn meanwhile
            put(item)
        await asyncio.to_thread(partial(put, 999))
        await all_there.wait()
        assert came in ([7, 8, 9, 999], [8, 9, 999])

    asyncio.run(main())
