"""The journal's thread: groups, and what becomes of them while the store cannot be written."""

import asyncio
import threading
from collections.abc import Sequence

import pytest

from tests.runtime.loop_checks import run, until
from zacoustic.core.base.journal import JournalWrite
from zacoustic.errors import ConfigError
from zacoustic.run.journal import JournalState, thread
from zacoustic.run.journal.thread import JournalThread, recover, release


class FailingJournal:
    """Fails as long as it is told to, and keeps what it is given."""

    def __init__(self) -> None:
        self.failures: list[Exception] = []
        self.groups: list[list[tuple[int, str, bytes | None]]] = []
        self.tried: list[list[tuple[int, str, bytes | None]]] = []
        self.threads: set[int] = set()
        self.closed = 0

    def recover(self) -> JournalState:
        self.threads.add(threading.get_ident())
        return JournalState(boot_epoch=1)

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        group = [(write.write_id, write.key, write.value) for write in writes]
        self.tried.append(group)
        if self.failures:
            raise self.failures.pop(0)
        self.groups.append(group)

    def close(self) -> None:
        self.threads.add(threading.get_ident())
        self.closed += 1


class Owner:
    """What the runner is for the thread."""

    def __init__(self, journal: FailingJournal) -> None:
        self.committed: list[int] = []
        self.states: list[str] = []
        self.faults: list[Exception] = []
        self.changed = asyncio.Event()
        self.thread = JournalThread(
            journal, committed=self._committed, state_changed=self._state, fail=self._fail
        )

    def _committed(self, group: Sequence[JournalWrite]) -> None:
        self.committed += [write.write_id for write in group]
        self.changed.set()

    def _state(self, failure: str) -> None:
        self.states.append(failure)
        self.changed.set()

    def _fail(self, error: Exception) -> None:
        self.faults.append(error)
        self.changed.set()


def write(write_id: int, key: str, value: bytes | None = b"") -> JournalWrite:
    return JournalWrite(write_id=write_id, key=key, value=value)


@pytest.fixture
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thread, "FIRST_RETRY_S", 0.0001)


@pytest.mark.usefixtures("_soon")
def test_failed_group_is_tried_again_in_order_with_what_has_come_since() -> None:
    async def main() -> None:
        journal = FailingJournal()
        journal.failures = [OSError("full"), OSError("full"), OSError("read-only")]
        owner = Owner(journal)
        owner.thread.put(write(1, "a", b"old"))
        owner.thread.put(write(2, "b", b"2"))
        await until(lambda: owner.states, owner.changed)
        owner.thread.put(write(3, "a", b"new"))
        await until(lambda: owner.committed, owner.changed)
        assert owner.states == ["full", "read-only", ""]
        assert owner.committed == [1, 2, 3]
        assert {key: value for _, key, value in journal.groups[0]} == {"a": b"new", "b": b"2"}
        # The value that is superseded is not held for as long as the disk is full.
        assert (1, "a", None) in journal.groups[0]
        owner.thread.put(write(4, "c"))
        await until(lambda: 4 in owner.committed, owner.changed)
        await owner.thread.close()
        assert owner.faults == []

    run(main())


def test_time_between_attempts_doubles_up_to_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        journal = FailingJournal()
        journal.failures = [OSError("full")] * 9
        owner = Owner(journal)
        loop, waits, tried = asyncio.get_running_loop(), list[float](), asyncio.Event()
        later = loop.call_later

        def at_once(delay_s: float, callback: object, *arguments: object) -> asyncio.TimerHandle:
            waits.append(delay_s)
            tried.set()
            return later(0.0, callback, *arguments)  # type: ignore[arg-type]

        monkeypatch.setattr(loop, "call_later", at_once)
        owner.thread.put(write(1, "a"))
        await until(lambda: owner.committed, owner.changed)
        assert waits == [1, 2, 4, 8, 16, 32, 60, 60, 60]
        journal.failures = [OSError("full")]
        owner.thread.put(write(2, "a"))
        await until(lambda: 2 in owner.committed, owner.changed)
        assert waits[9:] == [1]
        await owner.thread.close()

    run(main())


def test_write_that_comes_while_an_attempt_is_due_makes_no_attempt_of_its_own() -> None:
    async def main() -> None:
        journal = FailingJournal()
        journal.failures = [OSError("full")]
        owner = Owner(journal)
        owner.thread.put(write(1, "a"))
        await until(lambda: owner.states, owner.changed)
        for number in range(2, 100):
            owner.thread.put(write(number, "a"))
        assert len(journal.tried) == 1
        await owner.thread.close()  # which is the next attempt
        assert len(journal.tried) == 2
        assert owner.committed == list(range(1, 100))

    run(main())


def test_close_tries_once_more_and_says_what_was_not_kept(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        journal = FailingJournal()
        journal.failures = [OSError("full")] * 3
        owner = Owner(journal)
        owner.thread.put(write(1, "a"))
        owner.thread.put(write(2, "b"))
        await until(lambda: owner.states, owner.changed)
        await owner.thread.close()
        assert len(journal.tried) == 2
        assert owner.committed == []
        assert journal.closed == 1

    run(main())
    assert "2 writes were not kept: full" in caplog.text


@pytest.mark.parametrize("place", ["store", "owner"])
def test_fault_of_the_program_ends_the_commits_and_is_told(place: str) -> None:
    async def main() -> None:
        journal = FailingJournal()
        owner = Owner(journal)
        if place == "store":
            journal.failures = [KeyError("a bug")]
        else:

            def fault(group: Sequence[JournalWrite]) -> None:
                raise OSError("not the journal's")

            owner.thread._committed = fault
        owner.thread.put(write(1, "a"))
        await until(lambda: owner.faults, owner.changed)
        assert [type(fault) for fault in owner.faults] == [
            KeyError if place == "store" else OSError
        ]
        owner.thread.put(write(2, "a"))
        await owner.thread.close()
        assert len(journal.tried) == 1
        assert journal.closed == 1

    run(main())


def test_recover_and_release_run_off_the_loop() -> None:
    async def main() -> None:
        journal = FailingJournal()
        assert (await recover(journal)).boot_epoch == 1
        await release(journal)
        assert journal.threads
        assert threading.get_ident() not in journal.threads

        def refuse() -> JournalState:
            raise ConfigError("damaged")

        journal.recover = refuse  # type: ignore[method-assign]
        with pytest.raises(ConfigError, match="damaged"):
            await recover(journal)

    run(main())
