"""From a modem's bytes to messages, independent of how the bytes are cut.

Three rules keep the stream readable:

- Length decides. The decoder takes the announced bytes of a payload, whatever they look like; if no
  CR LF follows them, it gives up only the first line of the record and continues after that.
- A decision waits for the bytes that it depends on, and depends on no others. So the same bytes
  give the same messages in one piece or one by one (pieces of `RawData` apart).
- Waiting is bounded: announced lengths by `PAYLOAD_LIMIT_BYTES`, lines by `LINE_LIMIT_BYTES`.

A length damaged on its way makes the decoder wait for bytes that may never come. It has no clock;
its owner calls `flush` when the port has been silent while `held_bytes` is not 0.

In LINES the decoder also reads packets, wherever they begin: a modem with the NET interpreter never
sends one, so a packet reveals at start-up that this modem is in data mode.
"""

from typing import Final

from zacoustic_evologics.at.framing import (
    BODY_LIMIT_BYTES,
    CRLF,
    HEADER_LIMIT_BYTES,
    PACKET_START,
    Framing,
    Gap,
    Packet,
    packet_start_overlap,
    read_packet,
)
from zacoustic_evologics.at.layouts import PAYLOAD_TOKENS, decode_line, decode_payload_record
from zacoustic_evologics.at.messages import Message, RawData, Reply, Unrecognised

LINE_LIMIT_BYTES: Final = 1024
"""Longest line; the longest known, USBLPHYP, has 245."""
HELD_LIMIT_BYTES: Final = BODY_LIMIT_BYTES + LINE_LIMIT_BYTES + HEADER_LIMIT_BYTES
"""Most bytes held between two calls."""

_PAYLOAD_STARTS: Final = tuple(
    (token.encode() + b",", layout) for token, layout in PAYLOAD_TOKENS.items()
)


class AtDecoder:
    """Reads the messages of one port of a modem.

    Args:
        framing: Framing of the connection; may be changed at any time, and also applies to the held
            bytes.
    """

    def __init__(self, framing: Framing = Framing.LINES) -> None:
        self.framing = framing
        self._buffer = bytearray()

    @property
    def held_bytes(self) -> int:
        """Number of bytes waiting for more, at most `HELD_LIMIT_BYTES`."""
        return len(self._buffer)

    def feed(self, received: bytes) -> list[Message]:
        """Take bytes, return the messages that they complete. Never raises on their content."""
        self._buffer += received
        messages: list[Message] = []
        while self._buffer:
            step = self._read()
            if step is None:
                break
            message, taken = step
            self._take(message, taken, messages)
        return messages

    def flush(self) -> list[Message]:
        """Give up incomplete messages, and return all held bytes as messages.

        Call it when the port has been silent too long, or was closed.
        """
        messages: list[Message] = []
        while self._buffer:
            step = self._read() or self._give_up()
            self._take(*step, messages)
        return messages

    def _take(self, message: Message, taken: int, messages: list[Message]) -> None:
        del self._buffer[:taken]
        previous = messages[-1] if messages else None
        if isinstance(message, RawData) and isinstance(previous, RawData):
            messages[-1] = RawData(previous.content + message.content)
        else:
            messages.append(message)

    def _read(self) -> tuple[Message, int] | None:
        if self.framing is Framing.PACKETS:
            return self._read_packet_or_data()
        for start, layout in _PAYLOAD_STARTS:
            if self._buffer.startswith(start):
                record = decode_payload_record(self._buffer, layout)
                if record is Gap.INCOMPLETE:
                    return None
                if not isinstance(record, Gap):
                    return record
        return self._read_packet_or_line()

    def _read_packet_or_data(self) -> tuple[Message, int] | None:
        start = self._buffer.find(PACKET_START)
        if start < 0:
            start = len(self._buffer) - packet_start_overlap(self._buffer)
        if start > 0:
            return RawData(bytes(self._buffer[:start])), start
        packet = read_packet(self._buffer) if len(self._buffer) >= len(PACKET_START) else None
        if packet is None or packet is Gap.INCOMPLETE:
            return None
        if isinstance(packet, Gap):
            return RawData(PACKET_START), len(PACKET_START)
        return _decode_packet(packet), packet.end

    def _read_packet_or_line(self) -> tuple[Message, int] | None:
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
                    return Unrecognised(bytes(buffer[:start])), start
                return _decode_packet(packet), packet.end
            start = buffer.find(PACKET_START, start + 1, end + reach)
        if line_feed >= 0:
            line = bytes(buffer[:line_feed]).removesuffix(b"\r")
            return _decode_text(line, None), line_feed + 1
        if len(buffer) < LINE_LIMIT_BYTES + reach:
            return None
        return Unrecognised(bytes(buffer[:LINE_LIMIT_BYTES])), LINE_LIMIT_BYTES

    def _give_up(self) -> tuple[Message, int]:
        if self.framing is Framing.PACKETS:
            taken = min(len(PACKET_START), len(self._buffer))
            return RawData(bytes(self._buffer[:taken])), taken
        line = bytes(self._buffer[:LINE_LIMIT_BYTES]).partition(b"\n")
        return Unrecognised(line[0].removesuffix(b"\r")), len(line[0]) + len(line[1])


def _decode_packet(packet: Packet) -> Message:
    body = packet.body
    for start, layout in _PAYLOAD_STARTS:
        if body.startswith(start) and packet.name in ("", "?NOISE"):
            record = decode_payload_record(body + CRLF, layout)
            if not isinstance(record, Gap) and record[1] == len(body) + len(CRLF):
                return record[0]
            return Unrecognised(body)
    return _decode_text(body, packet.name)


def _decode_text(text: bytes, command: str | None) -> Message:
    allowed = b"\t" if command is None else b"\t\r\n"
    if not all(32 <= byte < 127 or byte in allowed for byte in text):
        return Unrecognised(text)
    line = text.decode("ascii")
    record = None if command else decode_line(line)
    if isinstance(record, Gap):
        return Unrecognised(text)
    return Reply(line, command) if record is None else record
