"""The verb `zacoustic decode`: frames in words."""

import argparse
import json
import sys
from collections.abc import Iterable, Iterator

from zacoustic.command import EXIT_FAILED, EXIT_OK, Command


class DecodeCommand(Command):
    """Says what is in frames."""

    name = "decode"
    summary = "say in words what is in a frame"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare frames, table and source."""
        parser.add_argument(
            "frames", metavar="HEX", nargs="*",
            help="one frame each, in hexadecimal; without any, frames are read from standard "
            "input, one in a line: hexadecimal, or a JSON object with the key `frame`",
        )  # fmt: skip
        parser.add_argument("--config", metavar="FILE", help="file with the streams and types")
        parser.add_argument(
            "--source", type=int, default=0, metavar="N", help="address of the sender"
        )
        parser.add_argument("--json", action="store_true", help="one JSON object for each frame")
        parser.epilog = (
            "example:\n"
            "  zacoustic decode b00100017d1f3a09b10001\n"
            "  zacoustic sim water.json5 --trace trace.jsonl && "
            "zacoustic decode --config fleet.json5 < trace.jsonl"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print each frame; fails when something was not hexadecimal.

        Raises:
            ConfigError: The configuration is wrong.
        """
        import msgspec

        from zacoustic.tools.decode import decode_frame

        table = None
        if arguments.config is not None:
            from zacoustic.config import read_config

            table = read_config(arguments.config).table
        code = EXIT_OK
        for text in arguments.frames or _frames_in(sys.stdin):
            frame = _from_hex(text)
            if frame is None:
                shown = text if len(text) <= 40 else f"{text[:40]}…"
                print(f"zacoustic decode: {shown!r} is not hexadecimal", file=sys.stderr)
                code = EXIT_FAILED
                continue
            items = decode_frame(frame, table, source=arguments.source)
            if arguments.json:
                found = {"frame": frame.hex(), "items": msgspec.to_builtins(items)}
                print(json.dumps(found, ensure_ascii=False))
            else:
                print(f"{len(frame)} bytes: {frame.hex()}")
                print("".join(f"  {item.text}\n" for item in items), end="")
        return code


def _frames_in(lines: Iterable[str]) -> Iterator[str]:
    """The frames of a text or of a trace; lines without any are passed over."""
    for line in lines:
        text = line.strip()
        if text.startswith("{"):
            try:
                found = json.loads(text)
            except (ValueError, RecursionError):
                yield text
                continue
            text = str(found.get("frame", ""))
        if text:
            yield text


def _from_hex(text: str) -> bytes | None:
    """The bytes of a text such as `b001…`, `0xb0 0x01` or `b0:01`, or None."""
    digits = text.replace("0x", "").replace(":", "").replace(",", "")
    try:
        return bytes.fromhex(digits)
    except ValueError:
        return None
