"""Hypothesis strategies for every record of the grammar, made from the tables of the grammar."""

from collections.abc import Callable
from typing import Any, Final

from hypothesis import strategies as st

from zacoustic_evologics.at.commands import (
    Act,
    Action,
    Command,
    ExtensionCommand,
    Help,
    Query,
    SendBurst,
    SendIm,
    SendIms,
    SendPbm,
    SendProbe,
    Set,
    SetOption,
)
from zacoustic_evologics.at.encoder import BROADCAST, BURST_LIMIT_BYTES, NUMBERED_ACTIONS
from zacoustic_evologics.at.fields import Choice, Decimal, Field, Integer, Seconds, Word
from zacoustic_evologics.at.layouts import (
    FIRMWARE_1_6_LAYOUTS,
    IM_LIMIT_BYTES,
    LINE_LAYOUTS,
    PAYLOAD_LAYOUTS,
    Layout,
)
from zacoustic_evologics.at.notifications import AsyncError, Extension, FaultKind, ImFlag
from zacoustic_evologics.at.settings import SETTINGS

ALL_LAYOUTS: Final = PAYLOAD_LAYOUTS + FIRMWARE_1_6_LAYOUTS + LINE_LAYOUTS
WORDS: Final = st.from_regex(r"[!-+\--~ ]{1,40}", fullmatch=True)
NAMES: Final = st.from_regex("[A-Z]{1,12}", fullmatch=True)
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


def limits(field: Field) -> tuple[Any, ...]:
    """Give the values of a field at its limits."""
    match field:
        case Integer():
            return field.low, field.high
        case Decimal():
            return -field.limit, 0.0, field.limit, 10.0**-field.decimals
        case Seconds():
            return 0, 1, 10**16 - 1
        case Choice():
            return tuple(field.kind)
        case Word():
            return "!", "~" * 40
        case _:
            raise AssertionError(field)


def beyond(field: Field) -> tuple[Any, ...]:
    """Give values that a field does not allow."""
    match field:
        case Integer():
            return field.low - 1, field.high + 1, 1.5, "1", None
        case Decimal():
            return field.limit * 1.1, -field.limit * 1.1, float("nan"), float("inf"), "1.0", None
        case Seconds():
            return -1, 10**16, 1.5, None
        case Choice():
            return "ack", None
        case Word():
            return "", "a,b", "a\r\nb", "~" * 41, "ä", None
        case _:
            raise AssertionError(field)


def values(field: Field) -> st.SearchStrategy[Any]:
    """Give any value of a field."""
    match field:
        case Integer():
            inner: st.SearchStrategy[Any] = st.integers(field.low, field.high)
        case Decimal():
            scale = 10**field.decimals
            top = int(field.limit) * scale
            inner = st.integers(-top, top).map(lambda number: number / scale)
        case Seconds():
            inner = st.integers(0, 10**16 - 1)
        case Word():
            inner = WORDS
        case _:
            inner = st.nothing()
    return st.one_of(inner, st.sampled_from(limits(field)))


def records(layout: Layout) -> st.SearchStrategy[Any]:
    """Give records of one layout."""
    made: dict[str, st.SearchStrategy[Any]] = {}
    for name, field, *several in layout.columns:
        one = values(field)
        made[name] = st.tuples(*[one] * several[0]) if several else one
    if layout.payload_limit is not None:
        made["payload"] = payloads(min(layout.payload_limit, BURST_LIMIT_BYTES))
        if layout.has_addresses:
            made["pid"] = st.none() | st.integers(0, 7)
    return st.builds(layout.record, **made)


EXTENSIONS: Final = st.builds(
    Extension,
    st.from_regex(r"[!-+\--~]{1,40}", fullmatch=True),
    st.from_regex("[ -~]{0,40}", fullmatch=True),
)
NOTIFICATIONS: Final = st.one_of(
    *[records(layout) for layout in ALL_LAYOUTS],
    st.sampled_from([AsyncError(fault) for fault in FaultKind]),
    EXTENSIONS,
)
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
NUMBERS: Final = st.integers(-(2**63) + 1, 2**63 - 1)
CLOCKS: Final = st.none() | st.integers(0, 2**32 - 1)


def _pid() -> st.SearchStrategy[int | None]:
    return st.none() | st.integers(0, 7)


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


IM_PAYLOADS: Final = payloads(IM_LIMIT_BYTES, 1)
MODEMS: Final = st.integers(1, BROADCAST - 1)
PAYLOAD_COMMANDS: Final[st.SearchStrategy[Command]] = st.one_of(
    st.builds(
        SendIm,
        payload=IM_PAYLOADS,
        destination=MODEMS,
        flag=st.sampled_from(ImFlag),
        pid=_pid(),
    ),
    st.builds(
        SendIm,
        payload=IM_PAYLOADS,
        destination=st.just(BROADCAST),
        flag=st.sampled_from([ImFlag.NOACK, ImFlag.FORCE]),
        pid=_pid(),
    ),
    st.builds(
        SendIms,
        payload=IM_PAYLOADS,
        destination=st.integers(1, BROADCAST),
        start_us=CLOCKS,
        pid=_pid(),
    ),
    st.builds(SendPbm, payload=IM_PAYLOADS, destination=MODEMS, pid=_pid()),
    st.builds(SendBurst, payload=payloads(BURST_LIMIT_BYTES, 1), destination=MODEMS, pid=_pid()),
)
LINE_COMMANDS: Final[st.SearchStrategy[Command]] = st.one_of(
    st.builds(SendProbe, bit=NUMBERS, follow=NUMBERS, start_us=CLOCKS),
    st.builds(Query, NAMES),
    _setting(Set, "!"),
    _setting(SetOption, "@"),
    st.builds(SetOption, NAMES),
    st.sampled_from([Act(action) for action in Action]),
    st.builds(
        Act,
        st.sampled_from([each for each in Action if each.value in NUMBERED_ACTIONS]),
        st.integers(0, 255),
    ),
    st.builds(Help, st.from_regex("[?!@&%*]?[A-Z]{1,12}", fullmatch=True)),
    st.builds(ExtensionCommand, NAMES, st.from_regex("[ -~]{0,40}", fullmatch=True)),
)
COMMANDS: Final = st.one_of(PAYLOAD_COMMANDS, LINE_COMMANDS)
