"""Public names for links on TCP or a serial port: `zacoustic.link.bytestream`."""

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
