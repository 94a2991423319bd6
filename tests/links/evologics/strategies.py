"""Hypothesis strategies for every record of the grammar, made from the tables of the grammar."""

from collections.abc import Callable
from typing import Any, Final

from hypothesis import strategies as st

from tests.links.fieldvalues import records
from zacoustic_evologics.at import table
from zacoustic_evologics.at.commands import Command, Set, SetOption
from zacoustic_evologics.at.fields import BURST_LIMIT_BYTES
from zacoustic_evologics.at.settings import SETTINGS
from zacoustic_evologics.at.table import FIRMWARE_1_6, LINE_RECORDS, PAYLOAD_RECORDS, Row

ALL_ROWS: Final = PAYLOAD_RECORDS + tuple(FIRMWARE_1_6.values()) + LINE_RECORDS
"""All that a modem says unasked."""
NASTY_PIECES: Final = (
    b"\r\n", b"\n", b"\r", b",", b":", b"+", b"+++", b"+++AT", b"OK", b"\x00", b"\xff", b"AT?S\n",
    b"DELIVEREDIM,3\r\n", b"+++AT:13:DELIVEREDIM,3\r\n", b"RECVIM,5,2,1,ack,", b"hello", b"p0,",
)  # fmt: skip
"""What a payload can contain that looks like the grammar."""


def payloads(limit: int, least: int = 0) -> st.SearchStrategy[bytes]:
    """Give payloads with nasty pieces in them, cut to the limit."""
    nasty = st.lists(st.sampled_from(NASTY_PIECES), min_size=1, max_size=20).map(b"".join)
    return st.one_of(
        st.binary(min_size=least, max_size=min(limit, 64)), nasty.map(lambda all: all[:limit])
    )


def others(row: Row) -> dict[str, st.SearchStrategy[Any]]:
    """Give what the text of a row does not have, or has otherwise: the payload."""
    if row.payload is None:
        return {}
    return {"payload": payloads(min(row.payload.longest, BURST_LIMIT_BYTES), row.payload.shortest)}


def rows(row: Row) -> st.SearchStrategy[Any]:
    """Give records of one row that may be written."""
    return records(row, **others(row)).filter(lambda record: not row.refusal(record))


def names(chosen: tuple[Row, ...]) -> list[str]:
    """Give names of rows for the names of tests."""
    return [f"{row.record.__name__}-{len(row.fields)}" for row in chosen]


NOTIFICATIONS: Final = st.one_of(*[rows(row) for row in ALL_ROWS])
PLAIN_REPLIES: Final = st.one_of(
    st.sampled_from(
        ["OK", "[*]OK", "FAILED", "DELIVERED", "825", "-0.0341", "BUSY", "NET", "", "1.9"]
    ),
    st.from_regex(r"(ERROR|BUSY) [A-Z]{1,8}( [A-Z]{1,3})*", fullmatch=True).filter(
        lambda text: text not in ("ERROR EFAULT", "ERROR OVERLOAD")
    ),
    st.integers(0, 2**32).map(str),
)
REPLY_NAMES: Final = st.sampled_from(["*SENDIM", "?MODE", "I", "Z", "!L", "@ZX", "?AL", ""])
PACKET_REPLIES: Final = PLAIN_REPLIES | st.from_regex(
    r"([A-Z][a-z :0-9]{0,20}\n){1,8}", fullmatch=True
)


def _setting(make: Callable[[str, int], Command], prefix: str) -> st.SearchStrategy[Command]:
    known = [setting for setting in SETTINGS.values() if setting.prefix == prefix]
    return st.sampled_from(known).flatmap(
        lambda setting: st.builds(
            make,
            st.just(setting.name),
            st.sampled_from(setting.choices or (setting.low, setting.high))
            | st.integers(setting.low, setting.high).filter(setting.allows),
        )
    )


PAYLOAD_COMMANDS: Final[st.SearchStrategy[Command]] = st.one_of(
    *[rows(row) for row in table.PAYLOAD_COMMANDS]
)
LINE_COMMANDS: Final[st.SearchStrategy[Command]] = st.one_of(
    _setting(Set, "!"),
    _setting(SetOption, "@"),
    *[rows(row) for row in table.LINE_COMMANDS],
)
COMMANDS: Final = st.one_of(PAYLOAD_COMMANDS, LINE_COMMANDS)
