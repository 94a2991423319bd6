"""The verb `zacoustic replay`: a recording again, exactly, or in another way."""

import argparse
import json

from zacoustic.command import EXIT_FAILED, EXIT_OK, Command


class ReplayCommand(Command):
    """Plays a recording back."""

    name = "replay"
    summary = "play a recording back: into engines, byte for byte, or otherwise"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare recording and what to do with it."""
        parser.add_argument("recording", metavar="FILE", help="recording, MCAP")
        parser.add_argument(
            "--check",
            action="store_true",
            help="make every engine again and compare frames, events and timers, byte for byte",
        )
        parser.add_argument("--json", action="store_true", help="one JSON object")
        parser.epilog = (
            "exits with 1 when anything differs\n\nexample:\n  zacoustic replay trial.mcap --check"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Replay.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        return _check(arguments)


def _check(arguments: argparse.Namespace) -> int:
    import msgspec

    from zacoustic.tools.recordings.checking import check_recording
    from zacoustic.tools.recordings.checktext import as_text

    verdict = check_recording(arguments.recording)
    if arguments.json:
        found = {**msgspec.to_builtins(verdict), "is_same": verdict.is_same}
        print(json.dumps(found, ensure_ascii=False))
    else:
        print(as_text(verdict))
    return EXIT_OK if verdict.is_same else EXIT_FAILED
