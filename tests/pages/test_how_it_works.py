"""Twelve questions about promises and costs that `docs/how-it-works.md` alone answers.

Each has its answer, and what of it the page must say, as it stands there.
"""

import re
from typing import Any, Final

import pytest

from tests.pages.blocks import ROOT, blocks_of
from zacoustic.app.tools.inspect.decode.decoder import decode_frame
from zacoustic.config import config_from_mapping
from zacoustic.json5 import parse_json5

PAGE: Final = ROOT / "docs" / "how-it-works.md"
WORDS_MOST: Final = 900

QUESTIONS: Final = (
    (
        "What does an idle system transmit?",
        "Nothing: no timer, no discovery, no heartbeat unless you ask for it.",
        ("an idle system transmits nothing", "Nobody notices by default"),
    ),
    (
        "What does a best-effort sample cost beside its payload, and why?",
        "One byte, the id of its stream: both ends have the table that says what the id means.",
        ("a record begins with one byte, the stream's id", "| 1 byte |"),
    ),
    (
        "What does it cost to be sure that a sample has arrived?",
        "One byte more, and an acknowledgement of 3 or 4 bytes from each subscriber.",
        ("acknowledged by each subscriber", "2 bytes, and 3 or 4 back"),
    ),
    (
        "A sample is DELIVERED: has the program at the other end read it?",
        "Not necessarily: the other engine has it. A call says that a program acted.",
        ("the other engine has the sample", "its program may not have read it yet", "use a call"),
    ),
    (
        "I publish ten reliable samples during an outage; how many arrive afterwards?",
        "The newest `depth`, one unless the file says more; the others end as SUPERSEDED.",
        ("keeps the newest `depth` samples, 1 unless you say more", "SUPERSEDED"),
    ),
    (
        "A call has timed out: may I repeat it?",
        "It may have been executed, once, and its answer lost. Repeat it if twice is harmless.",
        ("A call that times out may have been executed", "executed at most once"),
    ),
    (
        "What does a call cost beside its payloads?",
        "Two bytes each for request, answer and confirm.",
        ("2 bytes, three times", "2 bytes each for request, answer and confirm"),
    ),
    (
        "How long does a photo of 10 KiB take, and does a stop wait for it?",
        "About five minutes at 30 % loss; it pauses, so that the stop gets in between.",
        ("10 KiB at 30 % loss about 5", "an emergency gets in between", "up to 1 MiB"),
    ),
    (
        "The gateway is killed and starts again: what is lost?",
        "Without a journal its samples; with one, samples of journalled streams and goals go on.",
        ("streams with `journal: true`, and goals, go on", "Its samples are forgotten"),
    ),
    (
        "The other vehicle has an older file: what happens?",
        "The streams that differ stop, by name; the others go on; nothing is decoded wrongly.",
        ("the streams that differ stop, by name", "Nothing is decoded by a wrong table"),
    ),
    (
        "How do I know that the other side is dead?",
        "By a heartbeat that you ask for: it counts as lost after `lost_after_s`.",
        ("with `heartbeat_s` it is lost after `lost_after_s`", "`lost_contact` can surface"),
    ),
    (
        "Can somebody else with a modem command my vehicle?",
        "Yes, without a key. With one nobody can, for 5 bytes a frame.",
        ("Without a key anybody with a modem can read and forge frames", "| 5 bytes a frame |"),
    ),
)
"""Question, answer, and what the page says of it."""


def test_the_page_is_read_in_five_minutes() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert len(text.split()) <= WORDS_MOST
    assert len(blocks_of("docs/how-it-works.md")) == 1, "one picture"


def test_there_are_twelve_questions() -> None:
    assert len({question for question, _, _ in QUESTIONS}) == 12


@pytest.mark.parametrize(("question", "answer", "said"), QUESTIONS, ids=range(len(QUESTIONS)))
def test_the_page_alone_answers(question: str, answer: str, said: tuple[str, ...]) -> None:
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert [each for each in said if each not in text] == [], (question, answer)


def test_the_frame_of_the_picture_is_what_a_gateway_makes() -> None:
    (picture,) = blocks_of("docs/how-it-works.md")
    (line,) = re.findall(r"^ +((?:[0-9A-F]{2} +){12}[0-9A-F]{2})$", picture.text, re.MULTILINE)
    frame = bytes.fromhex(line)
    assert f"{len(frame)} bytes" in picture.text
    front = next(each for each in blocks_of("README.md") if each.name == "fleet.json5")
    whole: Any = parse_json5(front.text, source="README.md")
    section = whole["plugins"]["acoustic"]
    table = config_from_mapping(section, source="README.md").table
    (item,) = decode_frame(frame, table)
    assert item.value == {"lat": 43.09, "lon": 5.95, "depth": 12.3}
