"""From a modem's bytes to messages, independent of how the bytes are cut.

Besides the rule of all decoders (`StreamDecoder`), two keep the stream readable:

- Length decides. The decoder takes the announced bytes of a payload, whatever they look like; if no
  CR LF follows them, it gives up only the first line of the record and continues after that.
- Waiting is bounded: announced lengths by `PAYLOAD_LIMIT_BYTES`, lines by `LINE_LIMIT_BYTES`.

A length damaged on its way makes the decoder wait for bytes that may never come. It has no clock;
its owner calls `flush` when the port has been silent while `held_bytes` is not 0.

In LINES the decoder also reads packets, wherever they begin: a modem with the NET interpreter never
sends one, so a packet reveals at start-up that this modem is in data mode.
"""

import re
from typing import Final

from zacoustic_evologics.at.framing import (
    BODY_LIMIT_BYTES,
    CRLF,
    HEADER_LIMIT_BYTES,
    PACKET_START,
    Framing,
    Gap,
    Header,
    Packet,
    read_packet,
)
from zacoustic_evologics.at.messages import Message, RawData, Reply, Unrecognised
from zacoustic_evologics.at.notifications import AsyncError, Extension
from zacoustic_evologics.at.stream import StreamDecoder
from zacoustic_evologics.at.table import (
    FIRMWARE_1_6,
    LINE_RECORDS,
    NOTIFICATIONS,
    PAYLOAD_RECORDS,
    Record,
    Row,
)

LINE_LIMIT_BYTES: Final = 1024
"""Longest line; the longest known, USBLPHYP, has 245."""
HELD_LIMIT_BYTES: Final = BODY_LIMIT_BYTES + LINE_LIMIT_BYTES + HEADER_LIMIT_BYTES
"""Most bytes held between two calls."""

_BY_NAME: Final = {row.name: row for row in LINE_RECORDS}
_WORDED: Final = NOTIFICATIONS[AsyncError], NOTIFICATIONS[Extension]
_UNKNOWN: Final = ("RECV", "SEND", "USBL", "%")
"""No answer begins like this, so it is damaged, or a kind of a later firmware."""
_VELOCITY_OF_1_6: Final = re.compile(rb"-?[0-9]{1,5}\.[0-9]{1,6},")


class AtDecoder(StreamDecoder[Message]):
    """Reads the messages of one port of a modem; holds `HELD_LIMIT_BYTES` at most.

    Args:
        framing: Framing of the connection; may be changed at any time, and also applies to the held
            bytes.
    """

    def __init__(self, framing: Framing = Framing.LINES) -> None:
        super().__init__(framing)

    def flush(self) -> list[Message]:
        """Give up incomplete messages, and return all held bytes as messages.

        Call it when the port has been silent too long, or was closed.
        """
        return self._read_all(lambda: self._read() or self._give_up())

    def _read(self) -> Message | None:
        if self.framing is Framing.PACKETS:
            return self._read_raw() or self._read_packet()
        for row in PAYLOAD_RECORDS:
            if self._buffer.startswith(row.start):
                record = decode_payload_record(self._buffer, row)
                if record is Gap.INCOMPLETE:
                    return None
                if not isinstance(record, Gap):
                    self._take(record[1])
                    return record[0]
        return self._read_packet_or_line() if self._buffer else None

    def _read_packet(self) -> Message | None:
        if len(self._buffer) < len(PACKET_START):
            return None
        packet = read_packet(self._buffer)
        if packet is Gap.INCOMPLETE:
            return None
        if isinstance(packet, Gap):
            return RawData(self._take(len(PACKET_START)))
        self._take(packet.end)
        return _decode_packet(packet)

    def _read_packet_or_line(self) -> Message | None:
        buffer = self._buffer
        line_feed = buffer.find(b"\n", 0, LINE_LIMIT_BYTES)
        end = line_feed if line_feed >= 0 else LINE_LIMIT_BYTES
        reach = len(PACKET_START) - 1
        start = buffer.find(PACKET_START, 0, end + reach)
        while start >= 0:
            packet = read_packet(buffer, start)
            if packet is Gap.INCOMPLETE:
                return None
            if isinstance(packet, Packet):
                if start > 0:
                    return Unrecognised(self._take(start))
                self._take(packet.end)
                return _decode_packet(packet)
            start = buffer.find(PACKET_START, start + 1, end + reach)
        if line_feed >= 0:
            return _decode_text(self._take(line_feed + 1)[:-1].removesuffix(b"\r"), None)
        if len(buffer) < LINE_LIMIT_BYTES + reach:
            return None
        return Unrecognised(self._take(LINE_LIMIT_BYTES))

    def _give_up(self) -> Message | None:
        if not self._buffer:
            return None
        if self.framing is Framing.PACKETS:
            return RawData(self._take(len(PACKET_START)))
        line_feed = self._buffer.find(b"\n", 0, LINE_LIMIT_BYTES)
        line = self._take(line_feed + 1 if line_feed >= 0 else LINE_LIMIT_BYTES)
        return Unrecognised(line.removesuffix(b"\n").removesuffix(b"\r"))


def decode_payload_record(buffer: bytes | bytearray, row: Row) -> tuple[Record, int] | Gap:
    """Read a record with payload from the beginning of a buffer.

    Args:
        buffer: Begins with the name of the row and a comma.
        row: The row of firmware 1.9.

    Returns:
        The record and the number of bytes it took, CR LF included.
    """
    row, header = _choose_row(buffer, row)
    if isinstance(header, Gap):
        return header
    end = header.payload_end
    found = bytes(buffer[end : end + len(CRLF)])
    if not CRLF.startswith(found):
        return Gap.MALFORMED
    if found != CRLF:
        return Gap.INCOMPLETE
    record = row.read(header.text, payload=bytes(buffer[header.payload_start : end]))
    return Gap.MALFORMED if record is None else (record, end + len(CRLF))


def _choose_row(buffer: bytes | bytearray, row: Row) -> tuple[Row, Header | Gap]:
    header = row.read_header(buffer)
    older = FIRMWARE_1_6.get(row.record)
    if isinstance(header, Gap) or older is None or "." in header.text.split(",")[-2]:
        return row, header
    # While the next field is incomplete no CR LF is there, so the wrong row settles nothing.
    is_older = _VELOCITY_OF_1_6.match(buffer, header.payload_start)
    return (older, older.read_header(buffer)) if is_older else (row, header)


def _decode_packet(packet: Packet) -> Message:
    body = packet.body
    for row in PAYLOAD_RECORDS:
        if body.startswith(row.start) and packet.name in ("", "?NOISE"):
            record = decode_payload_record(body + CRLF, row)
            if not isinstance(record, Gap) and record[1] == len(body) + len(CRLF):
                return record[0]
            return Unrecognised(body)
    return _decode_text(body, packet.name)


def _decode_text(text: bytes, command: str | None) -> Message:
    allowed = b"\t" if command is None else b"\t\r\n"
    if not all(32 <= byte < 127 or byte in allowed for byte in text):
        return Unrecognised(text)
    line = text.decode("ascii")
    is_answer = command or "\n" in line or "\r" in line
    record = None if is_answer else _decode_line(line)
    if isinstance(record, Gap):
        return Unrecognised(text)
    return Reply(line, command) if record is None else record


def _decode_line(line: str) -> Record | Gap | None:
    """Return the notification that a line is; None: it is an answer; MALFORMED: it is damaged."""
    if line.startswith("CANCELLED"):  # the spelling that one driver has met
        line = line.replace("CANCELLED", "CANCELED", 1)
    name, comma, _ = line.partition(",")
    row = _BY_NAME.get(name)
    for each in _WORDED if row is None else (row,):
        if (record := each.read(line)) is not None:
            found: Record = record
            return found
    if row is None:
        return Gap.MALFORMED if name == "NOISE" or name.startswith(_UNKNOWN) else None
    # `FAILED` alone answers AT?DI: a notification with fields has a comma.
    return Gap.MALFORMED if comma or not row.commas else None
