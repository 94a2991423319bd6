"""Other programs that hold a port or a connection, as far as the operating system reports them.

A device that serves one program at a time may accept a second one and ignore it, and a serial port
that two programs read gives each of them half; neither reports that. On Linux, `/proc` lists the
open files of this computer's programs; for programs of other users it lists the connections,
without names.
"""

import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from zacoustic.link.bytestream.stream import parse_address

_PROC: Final = Path("/proc")
_ESTABLISHED: Final = "01"
_TABLES: Final = ("tcp", "tcp6")
_UNNAMED: Final = "a program of another user"


def holders(address: str) -> list[str]:
    """Return the other programs of this computer that have a device open, by name.

    Args:
        address: `tcp:HOST:PORT` or `serial:PORT`.

    Returns:
        Such as ``["minicom (4711)"]``; empty if there are none, or if the system does not report
        them.

    Raises:
        ConfigError: The address is neither of the two.
    """
    target = parse_address(address)
    if not sys.platform.startswith("linux"):
        return []
    if isinstance(target, str):
        wanted = {os.path.realpath(target)}
        return sorted(set(_programs(wanted)))
    inodes = set(_connections(*target))
    found = set(_programs({f"socket:[{inode}]" for inode in inodes}))
    own = {f"socket:[{inode}]" for inode in inodes} & set(_open_files(os.getpid()))
    if inodes and not found and len(own) < len(inodes):
        found.add(_UNNAMED)
    return sorted(found)


def _programs(wanted: set[str]) -> Iterator[str]:
    """Yield the other programs that have one of these files open."""
    if not wanted:
        return
    for entry in _PROC.iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        if wanted.intersection(_open_files(int(entry.name))):
            yield f"{_name(entry)} ({entry.name})"


def _open_files(pid: int) -> Iterator[str]:
    try:
        for each in (_PROC / str(pid) / "fd").iterdir():
            yield str(each.readlink())
    except OSError:  # it has ended, or belongs to another user
        return


def _name(entry: Path) -> str:
    try:
        return (entry / "comm").read_text(errors="replace").strip()
    except OSError:
        return "a program"


def _connections(host: str, port: int) -> Iterator[str]:
    """Yield the inodes of the established connections to a place."""
    try:
        places = {each[4][0] for each in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)}
    except OSError:
        return
    for name in _TABLES:
        try:
            lines = (_PROC / "net" / name).read_text().splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            place, _, hexadecimal = fields[2].partition(":")
            if fields[3] != _ESTABLISHED or int(hexadecimal, 16) != port:
                continue
            if _address(place) in places:
                yield fields[9]


def _address(written: str) -> str:
    """Read an address of `/proc/net`: words of four bytes, each in host byte order."""
    raw = bytes.fromhex(written)
    if sys.byteorder == "little":
        raw = b"".join(raw[at : at + 4][::-1] for at in range(0, len(raw), 4))
    if len(raw) == 16 and raw[:12] == bytes(10) + b"\xff\xff":
        raw = raw[12:]
    return socket.inet_ntop(socket.AF_INET if len(raw) == 4 else socket.AF_INET6, raw)
