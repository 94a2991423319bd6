"""Names of streams and addresses of nodes, for the completion of a command line."""

import re
from pathlib import Path
from typing import Final

from zacoustic.app.tools.fleetfile import read_fleet
from zacoustic.config import Config
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.errors import ConfigError

KINDS: Final[dict[str, tuple[type[StreamSpec], ...]]] = {
    "topic": (TopicSpec,),
    "service": (ServiceSpec,),
    "action": (ActionSpec,),
    "stream": (TopicSpec, ServiceSpec, ActionSpec),
    "node": (),
}
"""What can be named, and the specs of such streams; ``node``: addresses."""
_SUFFIXES: Final = (".json5", ".json", ".yaml", ".yml")
_NAMED: Final = re.compile(r"--config[= ]+(\S+)")


def names_for(kind: str, line: str, folder: Path) -> list[str]:
    """Return what may stand in a command line.

    Args:
        kind: One of `KINDS`.
        line: The command line so far; its file says what there is. Without one it is the only
            such file of the folder.
        folder: Where relative names of files begin.
    """
    file = _file_of(line, folder)
    if file is None:
        return []
    try:
        config = read_fleet(file, with_model=False)
    except (ConfigError, OSError):
        return []
    if kind == "node":
        return [str(address) for address in config.nodes]
    streams = [stream.spec for stream in config.table if isinstance(stream.spec, KINDS[kind])]
    return [name for spec in streams for name in _keys(spec.name, config)]


def _keys(name: str, config: Config) -> list[str]:
    """Return the keys of a stream; of one for each node, one for each."""
    if "{node}" not in name:
        return [name]
    return [name.replace("{node}", node) for node in config.nodes.values()]


def _file_of(line: str, folder: Path) -> Path | None:
    named = _NAMED.findall(line)
    named += [word for word in line.split() if word.endswith(_SUFFIXES)]
    files = [folder / Path(each).expanduser() for each in named]
    found = next((file for file in files if file.is_file()), None)
    if found is not None:
        return found
    here = [file for file in sorted(folder.glob("*.json5")) if _is_ours(file)]
    return here[0] if len(here) == 1 else None


def _is_ours(file: Path) -> bool:
    try:
        return "acoustic" in file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
