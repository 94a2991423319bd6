"""The transcripts are read as they say, and written as they are."""

from pathlib import Path
from typing import Any

import pytest

from tests.links.evologics.cutting import at_random, decoded, one_by_one
from tests.links.evologics.transcript import TRANSCRIPTS, Said, read_transcript
from zacoustic_evologics import (
    AtDecoder,
    CommandDecoder,
    Framing,
    Interpreter,
    encode_command,
    encode_message,
)
from zacoustic_evologics.at.commands import InvalidCommand
from zacoustic_evologics.at.table import LINE_RECORDS, PAYLOAD_RECORDS

BY_NAME = pytest.mark.parametrize("path", TRANSCRIPTS, ids=lambda path: path.stem)


@BY_NAME
@pytest.mark.parametrize("cut", ["whole", "one by one", "at random"])
def test_transcript_is_read_as_it_says(path: Path, cut: str) -> None:
    modem = AtDecoder()
    host = CommandDecoder(Interpreter.AT)
    for said in read_transcript(path):
        decoder: AtDecoder | CommandDecoder = host if said.by_host else modem
        decoder.framing = said.framing
        stream = said.content
        pieces = {
            "whole": [stream],
            "one by one": one_by_one(stream),
            "at random": at_random(stream, 3),
        }
        found = decoded(decoder, pieces[cut])
        assert found == list(said.records), said.content


# What the emulator said to mistakes of a host cannot be written by our encoders, which refuse them.
@pytest.mark.parametrize(
    "path",
    [path for path in TRANSCRIPTS if not path.stem.startswith("emulated")],
    ids=lambda path: path.stem,
)
def test_transcript_is_written_as_it_is(path: Path) -> None:
    for said in read_transcript(path):
        if said.canonical and not any(isinstance(each, InvalidCommand) for each in said.records):
            assert written(said) == said.content


def written(said: Said) -> bytes:
    if said.by_host:
        return b"".join(encode_command(record, said.framing) for record in said.records)
    return b"".join(encode_message(record, said.framing) for record in said.records)


def test_every_kind_of_notification_is_in_a_transcript() -> None:
    shown = {
        type(record)
        for path in TRANSCRIPTS
        for said in read_transcript(path)
        for record in said.records
    }
    kinds: set[Any] = {row.record for row in PAYLOAD_RECORDS + LINE_RECORDS}
    assert kinds <= shown


def test_lengths_of_the_captured_packets_are_theirs() -> None:
    said = read_transcript(next(path for path in TRANSCRIPTS if path.stem == "acknowledged_im"))
    bodies = [each.content.split(b":", 2)[1:] for each in said if not each.by_host]
    assert all(int(length) == len(body) - 2 for length, body in bodies)
    assert all(each.framing is Framing.PACKETS for each in said)
