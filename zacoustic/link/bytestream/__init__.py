"""A stream of bytes to a device, TCP or a serial port, which reconnects by itself."""

from zacoustic.link.bytestream.occupants import holders
from zacoustic.link.bytestream.stream import ByteStream, ByteStreamReceiver, ByteStreamState

__all__ = ["ByteStream", "ByteStreamReceiver", "ByteStreamState", "holders"]
