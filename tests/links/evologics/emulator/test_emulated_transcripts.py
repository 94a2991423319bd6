"""The emulator says what its transcripts show, and those are of the grammar without a gap."""

from typing import Any

import pytest

from tests.links.evologics.emulator.scenes import FOLDER, SCENES
from tests.links.evologics.transcript import read_transcript
from zacoustic_evologics import AtDecoder, encode_message
from zacoustic_evologics.at.messages import Unrecognised
from zacoustic_evologics.at.notifications import Extension, RecvIm, RecvPbm
from zacoustic_evologics.at.table import LINE_RECORDS, PAYLOAD_RECORDS

BY_NAME = pytest.mark.parametrize("name", SCENES)


@BY_NAME
def test_emulator_says_what_the_transcript_shows(name: str) -> None:
    assert SCENES[name]().text() == (FOLDER / f"{name}.txt").read_text(encoding="ascii")


@BY_NAME
def test_transcript_is_read_without_a_gap_and_written_as_it_is(name: str) -> None:
    modem = AtDecoder()
    for said in read_transcript(FOLDER / f"{name}.txt"):
        if said.by_host:
            continue
        modem.framing = said.framing
        messages = modem.feed(said.content)
        assert messages == list(said.records), said.content
        assert not any(isinstance(message, Unrecognised) for message in messages)
        if said.canonical:
            written = b"".join(encode_message(message, said.framing) for message in said.records)
            assert written == said.content


def test_every_kind_that_the_emulator_says_is_shown() -> None:
    shown = {
        type(record)
        for name in SCENES
        for said in read_transcript(FOLDER / f"{name}.txt")
        for record in said.records
    }
    kinds: set[Any] = {row.record for row in PAYLOAD_RECORDS + LINE_RECORDS}
    assert kinds - {Extension} <= shown
    assert Extension not in shown  # of the vendor's middleware: no modem says it


def test_both_layouts_of_messages_are_shown() -> None:
    shown = {
        (type(record), record.duration_us is None)
        for name in SCENES
        for said in read_transcript(FOLDER / f"{name}.txt")
        for record in said.records
        if isinstance(record, RecvIm | RecvPbm)
    }
    assert shown == {(RecvIm, False), (RecvIm, True), (RecvPbm, False), (RecvPbm, True)}
