"""The verb `zacoustic decode`: explains frames in words."""

import argparse
import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from zacoustic.app.cli.support.printing import print_json, print_note, print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.app.tools.inspect.decode.decoded import DecodedItem
    from zacoustic.app.tools.inspect.decode.opening import FrameOpener
    from zacoustic.config import Config
    from zacoustic.core.streams.table import StreamTable

_BROADCAST: Final = 255
_MOST_FRAMES: Final = 256


class DecodeCommand(Command):
    """Explains frames."""

    name = "decode"
    summary = "explain the contents of a frame"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare frames, table and source."""
        parser.add_argument(
            "frames", metavar="HEX|FILE", nargs="*",
            help="one frame each, in hexadecimal, in the order in which they were sent, or a "
            "recording (MCAP); without any, frames are read from standard input, one in a line: "
            "hexadecimal, or an object of a trace, which names the sender of the frame",
        )  # fmt: skip
        parser.add_argument("--config", metavar="FILE", help="file with the streams and types")
        parser.add_argument(
            "--log", metavar="LINK",
            help="the file is a log of the port of such a modem, both ways, as it was: evologics",
        )  # fmt: skip
        parser.add_argument(
            "--source", type=int, default=0, metavar="N", help="address of the sender"
        )
        parser.add_argument(
            "--wire", choices=("native", "rmw_desert"),
            help="wire profile (default: that of the configuration, native without one)",
        )  # fmt: skip
        parser.add_argument(
            "--unsealed", action="store_true",
            help="frames are not sealed, although the configuration has a key: those of `sim`",
        )  # fmt: skip
        parser.add_argument("--json", action="store_true", help="one JSON object for each frame")
        parser.epilog = (
            "example:\n"
            "  zacoustic decode b00200017d1f3a09b10001\n"
            "  zacoustic decode trial.mcap\n"
            "  zacoustic decode --log evologics --config fleet.json5 serial.log\n"
            "  zacoustic sim water.json5 --trace trace.jsonl && "
            "zacoustic decode --config fleet.json5 < trace.jsonl"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print each frame; fails if a text was not hexadecimal.

        Raises:
            ConfigError: The configuration is wrong, or a file is invalid or has no frames.
        """
        import msgspec

        from zacoustic.app.tools.inspect.decode.decoder import FrameDecoder
        from zacoustic.app.tools.inspect.decode.opening import said_in
        from zacoustic.core.streams.wireprofile import WireProfile

        table, opener, bonds = None, None, []
        if arguments.config is not None:
            from zacoustic.app.tools.fleetfile import read_fleet

            config = read_fleet(arguments.config)
            table = config.table
            bonds = [each.number for each in config.rules.bonds]
            opener = None if arguments.unsealed else _opener_of(config)
        code = EXIT_OK
        files = [each for each in arguments.frames if arguments.log or _is_file(each)]
        if arguments.log and not files:
            raise ConfigError("--log; allowed: with a file")
        if files:
            if len(arguments.frames) > 1:
                raise ConfigError(f"{files[0]} and more; allowed: one recording, or frames")
            return _decode_recording(arguments, table, opener)
        wire = None if arguments.wire is None else WireProfile(arguments.wire)
        decoder = FrameDecoder(table, wire=wire, bonds=bonds)
        destinations = _Destinations()
        written = [_Written(text) for text in arguments.frames]
        for each in written or _frames_in(sys.stdin):
            frame = _from_hex(each.text)
            if frame is None:
                shown = each.text if len(each.text) <= 40 else f"{each.text[:40]}…"
                print_note(f"zacoustic decode: {shown!r} is not hexadecimal")
                code = EXIT_FAILED
                continue
            unicast = destinations.is_unicast(frame, each.destination)
            source = arguments.source or each.source
            items = said_in(decoder, opener, frame, source, each.destination, unicast=unicast)
            if arguments.json:
                found = {"frame": frame.hex(), "items": msgspec.to_builtins(items)}
                print_json(found)
            else:
                _print_frame(f"{len(frame)} bytes: {frame.hex()}", items)
        return code


def _opener_of(config: "Config") -> "FrameOpener | None":
    """Return an object that opens the frames of a fleet; None: they are not sealed.

    Raises:
        ConfigError: Its key file cannot be used.
    """
    if config.security is None:
        return None
    from zacoustic.app.tools.inspect.decode.opening import FrameOpener
    from zacoustic.seal.keyring import open_keyring

    links = config.rules.of_links
    return FrameOpener(
        open_keyring(config.security, config.address).cipher,
        nodes=tuple(config.table.nodes) or tuple(range(1, _BROADCAST)),
        ports=[index if each.port is None else each.port for index, each in enumerate(links)],
        digest=config.table.digest,
    )


def _decode_recording(
    arguments: argparse.Namespace, table: "StreamTable | None", opener: "FrameOpener | None"
) -> int:
    """Print the frames of a recording, or of a log.

    Raises:
        ConfigError: It is neither, or has no frames.
    """
    from zacoustic.app.tools.inspect.recordings.replaying.frames import (
        decode_log,
        decode_recording,
        line_of,
    )
    from zacoustic.core.streams.wireprofile import WireProfile

    wire = None if arguments.wire is None else WireProfile(arguments.wire)
    began_ns, shown = 0, 0
    path = arguments.frames[0]
    if arguments.log is None:
        frames = decode_recording(path, table, wire=wire, opener=opener)
    else:
        frames = decode_log(path, arguments.log, table, wire=wire, opener=opener)
    for frame in frames:
        if arguments.source not in (0, frame.source):
            continue
        began_ns, shown = began_ns or frame.utc_ns or 0, shown + 1
        if arguments.json:
            print_json(frame)
        else:
            fault = f": {frame.fault}" if frame.fault else ""
            _print_frame(line_of(frame, began_ns) + fault, frame.items)
    if not shown:
        whose = f" of node {arguments.source}" if arguments.source else ""
        raise ConfigError(f"{path}: no frames{whose} in it")
    return EXIT_OK


def _print_frame(head: str, items: "Iterable[DecodedItem]") -> None:
    print_text("\n".join([one_line(head), *(f"  {one_line(item.text)}" for item in items)]))


class _Written(NamedTuple):
    """A frame with its text."""

    text: str
    source: int = 0
    """The sender; 0: unknown."""
    destination: int | None = None
    """The destination; None: unknown."""


class _Destinations:
    """Destinations of the last frames: the report of a reception lacks it."""

    def __init__(self) -> None:
        self._known: dict[bytes, int] = {}

    def is_unicast(self, frame: bytes, destination: int | None) -> bool:
        """Tell whether a frame is known to be for one node."""
        if destination is not None:
            self._known.pop(frame, None)
            self._known[frame] = destination
            if len(self._known) > _MOST_FRAMES:
                self._known.pop(next(iter(self._known)))
        return self._known.get(frame, _BROADCAST) != _BROADCAST


def _frames_in(lines: Iterable[str]) -> Iterator[_Written]:
    """Yield the frames of a text or of a trace; skip other lines."""
    for line in lines:
        text = line.strip()
        if text.startswith("{"):
            try:
                found = json.loads(text)
            except (ValueError, RecursionError):
                yield _Written(text)
                continue
            text = str(found.get("frame", ""))
            if text:
                yield _of_trace(text, found)
        elif text:
            yield _Written(text)


def _of_trace(text: str, record: dict[str, object]) -> _Written:
    """Return a frame of a trace: of the node itself, or of its peer."""
    node, peer = (
        number if isinstance(number := record.get(key), int) else 0 for key in ("node", "peer")
    )
    if record.get("what") == "transmit":
        return _Written(text, node, peer)
    return _Written(text, peer)


def _is_file(text: str) -> bool:
    """Tell whether an argument is meant as a file, existing or not: only names have such signs."""
    return _from_hex(text) is None and (bool({".", "/"} & {*text}) or Path(text).exists())


def _from_hex(text: str) -> bytes | None:
    """Return the bytes of a text such as `b002…`, `0xb0 0x01` or `b0:01`, or None."""
    digits = text.replace("0x", "").replace(":", "").replace(",", "")
    try:
        return bytes.fromhex(digits)
    except ValueError:
        return None
