"""The mark on samples from the channel: their publisher and their age.

A second local gateway hears what the first one puts and must not send it back. Nothing in a Zenoh
sample names its publisher, so the gateway writes it into the *attachment*, a CBOR map::

    {"acoustic": 2, "age_s": 1.3}
    {"acoustic": 2, "call": "2/17/20/5"}

`acoustic` is always there and comes first: the acoustic address of the node that published the
sample, that calls, or that answers. `age_s`, s, is there on streams with ``stamp: "age"``: the
sample's age when its frame was composed, and for an answer to a `get` also the time since then;
infinity means over an hour. `call` is there on calls: the call id. Everything with this mark stays
on its network. An attachment that an application sets does not cross the channel.
"""

from typing import Final

import cbor2
import msgspec
import zenoh

_NAME: Final = b"\x68acoustic"
# A CBOR map of 1…23 pairs begins with one byte, 0xA1…0xB7.
_MAP_FIRST: Final = 0xA1
_MAP_LAST: Final = 0xB7


class Marker(msgspec.Struct, frozen=True, kw_only=True):
    """The contents of the attachment."""

    acoustic: int
    """Acoustic address of the source, 1…254; 0 where the wire does not have it (rmw_desert)."""
    age_s: float | None = None
    """Age, s, ≥ 0; infinity: over an hour; None: not known."""
    call: str | None = None
    """Call id of a call: a text of `CallKey`."""

    def encode(self) -> bytes:
        """Return the attachment."""
        content: dict[str, int | float | str] = {"acoustic": self.acoustic}
        if self.age_s is not None:
            content["age_s"] = self.age_s
        if self.call is not None:
            content["call"] = self.call
        return cbor2.dumps(content)


def is_marked(attachment: bytes) -> bool:
    """Tell whether an attachment is one of a gateway; cheap, for each sample on Zenoh's thread."""
    return attachment[1 : 1 + len(_NAME)] == _NAME and _MAP_FIRST <= attachment[0] <= _MAP_LAST


def read_marker(attachment: bytes | zenoh.ZBytes | None) -> Marker | None:
    """Read an attachment; None when there is none, or it is not one of a gateway."""
    if isinstance(attachment, zenoh.ZBytes):
        attachment = attachment.to_bytes()
    if attachment is None or not is_marked(attachment):
        return None
    try:
        return msgspec.convert(cbor2.loads(attachment), Marker)
    except (cbor2.CBORDecodeError, EOFError, ValueError, TypeError, RecursionError):
        return None
