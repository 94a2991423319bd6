"""The verb `zacoustic decode`: explains frames in words."""

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.support.rows import flag, option, whole, word
from zacoustic.app.cli.support.verb import FleetVerb
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.app.tools.inspect.decode.decoded import DecodedItem
    from zacoustic.app.tools.inspect.decode.opening import FrameOpener
    from zacoustic.config import Config
    from zacoustic.core.streams.table import StreamTable
    from zacoustic.core.streams.wireprofile import WireProfile

_BROADCAST: Final = 255
_MOST_FRAMES: Final = 256


class Decode(FleetVerb):
    """Explain the contents of a frame.

    Example:
      zacoustic decode b00200017d1f3a09b10001
      zacoustic decode trial.mcap
      zacoustic decode --log evologics --config fleet.json5 serial.log
      zacoustic sim water.json5 --trace trace.jsonl && zacoustic decode --config fleet.json5 < trace.jsonl
    """  # noqa: E501 (wide on a terminal)

    frames: list[str] = word(
        "HEX|FILE",
        "one frame each, in hexadecimal, in the order in which they were sent, or a recording "
        "(MCAP); without any, frames are read from standard input, one in a line: hexadecimal, or "
        "an object of a trace, which names the sender of the frame",
        "*",
    )
    config: str | None = option("FILE", "file with the streams and types")
    log: str | None = option(
        "LINK", "the file is a log of the port of such a modem, both ways, as it was: evologics"
    )
    source: int = whole("N", "address of the sender", 0)
    wire: str | None = option(
        None,
        "wire profile (default: that of the configuration, native without one)",
        choices=("native", "rmw_desert"),
    )
    unsealed: bool = flag(
        "frames are not sealed, although the configuration has a key: those of `sim`"
    )
    json: bool = flag("one JSON object for each frame")

    def work(self) -> int:
        """Print each frame; fails if a text was not hexadecimal.

        Raises:
            ConfigError: The configuration is wrong, or a file is invalid or has no frames.
        """
        import msgspec

        from zacoustic.app.tools.inspect.decode.decoder import FrameDecoder
        from zacoustic.app.tools.inspect.decode.opening import said_in
        from zacoustic.core.streams.wireprofile import WireProfile

        table, opener, bonds = None, None, []
        config = self.fleet()
        if config is not None:
            table = config.table
            bonds = [each.number for each in config.rules.bonds]
            opener = None if self.unsealed else _opener_of(config)
        wire = None if self.wire is None else WireProfile(self.wire)
        files = [each for each in self.frames if self.log or _is_file(each)]
        if self.log and not files:
            raise ConfigError("--log; allowed: with a file")
        if files:
            if len(self.frames) > 1:
                raise ConfigError(f"{files[0]} and more; allowed: one recording, or frames")
            self._decode_recording(files[0], table, opener, wire)
            return EXIT_OK
        code = EXIT_OK
        decoder = FrameDecoder(table, wire=wire, bonds=bonds)
        destinations = _Destinations()
        written = [_Written(text) for text in self.frames]
        for each in written or _frames_in(sys.stdin):
            frame = _from_hex(each.text)
            if frame is None:
                shown = each.text if len(each.text) <= 40 else f"{each.text[:40]}…"
                self.note(f"{shown!r} is not hexadecimal")
                code = EXIT_FAILED
                continue
            unicast = destinations.is_unicast(frame, each.destination)
            source = self.source or each.source
            items = said_in(decoder, opener, frame, source, each.destination, unicast=unicast)
            if self.json:
                print_json({"frame": frame.hex(), "items": msgspec.to_builtins(items)})
            else:
                _print_frame(f"{len(frame)} bytes: {frame.hex()}", items)
        return code

    def _decode_recording(
        self,
        path: str,
        table: "StreamTable | None",
        opener: "FrameOpener | None",
        wire: "WireProfile | None",
    ) -> None:
        """Print the frames of a recording, or of a log.

        Raises:
            ConfigError: It is neither, or has no frames.
        """
        from zacoustic.app.tools.inspect.recordings.replaying.frames import (
            decode_log,
            decode_recording,
            line_of,
        )

        began_ns, shown = 0, 0
        if self.log is None:
            frames = decode_recording(path, table, wire=wire, opener=opener)
        else:
            frames = decode_log(path, self.log, table, wire=wire, opener=opener)
        for frame in frames:
            if self.source not in (0, frame.source):
                continue
            began_ns, shown = began_ns or frame.utc_ns or 0, shown + 1
            if self.json:
                print_json(frame)
            else:
                fault = f": {frame.fault}" if frame.fault else ""
                _print_frame(line_of(frame, began_ns) + fault, frame.items)
        if not shown:
            whose = f" of node {self.source}" if self.source else ""
            raise ConfigError(f"{path}: no frames{whose} in it")


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
