"""The frames in a log of a modem's port, both ways, from any logger.

Such a log comes from a terminal program, from `socat -r -R`, or from a network analyser that saves
TCP's stream: the bytes on the port, perhaps with times and prompts in between. So this reader does
not parse the log from beginning to end as the driver would. It finds a record by its first word,
takes the payload by its length, and skips all else. It does not search payloads again.
"""

import re
from collections.abc import Iterator
from typing import Final

from zacoustic.core.linktypes import BROADCAST
from zacoustic.link import LoggedFrame
from zacoustic_evologics.at.command_decoder import read_payload_command
from zacoustic_evologics.at.decoder import decode_payload_record
from zacoustic_evologics.at.framing import BODY_LIMIT_BYTES, CRLF, Gap
from zacoustic_evologics.at.notifications import Recv, RecvIm, RecvIms, RecvPbm
from zacoustic_evologics.at.table import PAYLOAD_RECORDS

_WORD: Final = re.compile(rb"AT\*SEND(?:IMS|IM|PBM)?,|(RECV(?:IMS|IM|PBM)?),")
_ROWS: Final = {row.start: row for row in PAYLOAD_RECORDS}
_RECORD_BYTES: Final = BODY_LIMIT_BYTES + len(CRLF)


def read_port_log(log: bytes) -> Iterator[LoggedFrame]:
    """Find the frames.

    Args:
        log: The whole log.
    """
    found = list(_records(log))
    # A log does not name its own node; the destination of messages from others does.
    own = next((to for is_sent, _, to, _ in found if not is_sent and to != BROADCAST), 0)
    for is_sent, source, destination, payload in found:
        yield LoggedFrame(
            frame_bytes=payload,
            source=own if is_sent else source,
            destination=destination,
            is_sent=is_sent,
        )


def _records(log: bytes) -> Iterator[tuple[bool, int, int, bytes]]:
    """Yield direction, source, destination and payload of each record."""
    at = 0
    while (word := _WORD.search(log, at)) is not None:
        at = word.end()
        piece = log[word.start() : word.start() + _RECORD_BYTES]
        if word[1] is None:
            sent = read_payload_command(piece)
            if not isinstance(sent, Gap) and (command := sent[0]) is not None:
                yield True, 0, command.destination, command.payload
                at = word.start() + sent[1] + 1
            continue
        read = decode_payload_record(piece, _ROWS[word[0]])
        if not isinstance(read, Gap):
            record, taken = read
            at = word.start() + taken
            if isinstance(record, Recv | RecvIm | RecvIms | RecvPbm):
                yield False, record.source, record.destination, record.payload
