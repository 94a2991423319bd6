"""Which commands are new."""

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.transport.commands.deduplication import DeduplicationTable, Freshness

NEW, SAME, OVERTAKEN = Freshness.NEW, Freshness.SAME, Freshness.OVERTAKEN


class Book:
    """A ledger and its journal."""

    def __init__(self, stored: dict[str, bytes] | None = None) -> None:
        self.journal = JournalPort()
        self.stored = stored or {}
        self.ledger = DeduplicationTable(self.stored, self.journal)
        self.kept: list[int] = []

    def enter(self, epoch: int, serial: int, *, client: int = 1, subject: int = 0) -> None:
        self.ledger.enter(client, subject, epoch, serial, self.kept.append)
        while (write := self.journal.poll()) is not None:
            assert write.value is not None
            self.stored[write.key] = write.value
            self.journal.committed(write.write_id, 7)

    def of(self, epoch: int, serial: int, *, client: int = 1, subject: int = 0) -> Freshness:
        return self.ledger.freshness(client, subject, epoch, serial)


def test_in_one_life_each_is_new_once_and_not_behind_a_later_one() -> None:
    book = Book()
    assert book.of(5, 9) is NEW
    book.enter(5, 9)
    assert book.kept == [7]
    assert [book.of(5, each) for each in (8, 9, 10)] == [OVERTAKEN, SAME, NEW]
    assert book.of(5, 9 + 32767) is NEW
    assert book.of(5, 9 + 32768) is OVERTAKEN


def test_serials_go_round() -> None:
    book = Book()
    book.enter(5, 65535)
    assert book.of(5, 0) is NEW
    book.enter(5, 0)
    assert book.of(5, 65535) is OVERTAKEN


def test_former_lives_give_no_commands() -> None:
    book = Book()
    for epoch in (5, 3, 900):
        assert book.of(epoch, 1) is NEW
        book.enter(epoch, 1)
    assert [book.of(each, 100) for each in (5, 3)] == [OVERTAKEN, OVERTAKEN]
    assert book.of(900, 2) is NEW
    for epoch in range(1000, 1020):
        book.enter(epoch, 1)
    assert len(book.stored["order/1/0"]) < 40  # bounded


def test_nodes_and_subjects_are_apart() -> None:
    book = Book()
    book.enter(5, 9)
    assert book.of(5, 1, client=3) is NEW
    assert book.of(5, 1, subject=17) is NEW


def test_it_survives_a_restart() -> None:
    book = Book()
    book.enter(4, 1)
    book.enter(5, 9, subject=17)
    book.enter(5, 9)
    after = Book(book.stored)
    assert [after.of(5, each) for each in (8, 9, 10)] == [OVERTAKEN, SAME, NEW]
    assert after.of(4, 30) is OVERTAKEN
    assert after.of(5, 9, subject=17) is SAME
