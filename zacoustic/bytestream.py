"""TCP or a serial port, as links see them: `zacoustic.link.bytestream`."""

from zacoustic.link.bytestream import (
    ByteStream,
    ByteStreamReceiver,
    ByteStreamState,
    holders,
)

__all__ = [
    "ByteStream",
    "ByteStreamReceiver",
    "ByteStreamState",
    "holders",
]
