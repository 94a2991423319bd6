"""The mark on samples from the channel: their publisher and their age.

A second local gateway receives the samples that the first one puts, and must not send them back.
Nothing in a Zenoh sample names its publisher, so the gateway writes it into the *attachment*, a
CBOR map::

    {"acoustic": 2, "age_s": 1.3, "age_error_s": 0.06}
    {"acoustic": 2, "call": "2/17/20/5"}

`acoustic` is always present and first: the acoustic address of the node that published, called or
answered. `age_s`, s, is present on streams with ``stamp: "age"``: the age of the sample as it is
put or given to a `get`; 30 days mean at least that, null means unknown. `age_error_s` says how
wrong that may be; it is absent where nothing bounds it.
`call` is present on calls: the call id. Samples with this mark stay on their network. An
application's attachment does not cross the channel.
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
    """Acoustic address of the source, 1…254; 0 if the wire does not have it (rmw_desert)."""
    age_s: float | None = None
    """Age, s, ≥ 0; 30 days: at least so old; None: unknown."""
    age_error_s: float | None = None
    """How wrong that may be, s; None: nothing bounds it."""
    is_stamped: bool = False
    """Whether its stream has ages, so that an unknown one is stated."""
    call: str | None = None
    """Call id of a call: a text of `CallKey`."""

    def encode(self) -> bytes:
        """Return the attachment."""
        content: dict[str, int | float | str | None] = {"acoustic": self.acoustic}
        if self.age_s is not None or self.is_stamped:
            content["age_s"] = self.age_s
        if self.age_error_s is not None:
            content["age_error_s"] = round(self.age_error_s, 3)
        if self.call is not None:
            content["call"] = self.call
        return cbor2.dumps(content)


def is_marked(attachment: bytes) -> bool:
    """Return whether an attachment is a gateway's; cheap, for each sample on Zenoh's thread."""
    return attachment[1 : 1 + len(_NAME)] == _NAME and _MAP_FIRST <= attachment[0] <= _MAP_LAST


def read_marker(attachment: bytes | zenoh.ZBytes | None) -> Marker | None:
    """Read an attachment; None: there is none, or it is not a gateway's."""
    if isinstance(attachment, zenoh.ZBytes):
        attachment = attachment.to_bytes()
    if attachment is None or not is_marked(attachment):
        return None
    try:
        return msgspec.convert(cbor2.loads(attachment), Marker)
    except (cbor2.CBORDecodeError, EOFError, ValueError, TypeError, RecursionError):
        return None
