"""A byte stream to a device, over TCP or a serial port, that reconnects by itself."""

from zacoustic.link.bytestream.occupants import holders
from zacoustic.link.bytestream.stream import ByteStream, ByteStreamReceiver, ByteStreamState

__all__ = ["ByteStream", "ByteStreamReceiver", "ByteStreamState", "holders"]
