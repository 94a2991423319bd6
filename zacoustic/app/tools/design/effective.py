"""The section of a file as it holds: checked, defaults filled in, without secrets."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.config import read_config
from zacoustic.config.json5 import read_zenoh_config
from zacoustic.config.sections import STREAMS, Section
from zacoustic.core.streams.table import StreamTable
from zacoustic.text.safetext import without_secrets

_MAY_BE_EMPTY: Final = ("ros", "fields")
"""Keys that say something even when they are empty."""


def effective_section(
    path: str | Path, *, address: int | None = None, locator: str | None = None
) -> dict[str, Any]:
    """Return the section of a file with every key that holds.

    Args:
        path: The file.
        address: Address of this node; overrides the file's.
        locator: Locator of the modem; overrides the file's links.

    Raises:
        ConfigError: As for `zacoustic.config.read_config`.
    """
    config = read_config(path, address=address, locator=locator)
    _, section = read_zenoh_config(path)
    assert isinstance(section, Mapping)  # it was read before
    known = {key: value for key, value in section.items() if key in Section.__struct_fields__}
    try:
        written = msgspec.to_builtins(msgspec.convert(known, Section))
    except msgspec.ValidationError:  # forms that reading alone understands: as they were written
        written = dict(known)
    streams = [_effective_stream(each, config.table) for each in known.get("streams", ())]
    links = [msgspec.to_builtins(each) for each in config.links]
    whole = {
        **written,
        "address": config.address,
        "links": [_without_passwords(each) for each in links],
        "streams": streams,
    }
    shortened: dict[str, Any] = _without_nothing(whole)
    return shortened


def _without_nothing(value: Any) -> Any:  # noqa: ANN401 (of the file)
    """Return a value without keys that have none: null, an empty text, list or table."""
    if isinstance(value, Mapping):
        lessened = {key: _without_nothing(each) for key, each in value.items()}
        return {
            key: each
            for key, each in lessened.items()
            if each not in (None, "", [], {}) or (key in _MAY_BE_EMPTY and each is not None)
        }
    if isinstance(value, list | tuple):
        return [_without_nothing(each) for each in value]
    return value


def _effective_stream(written: Any, table: StreamTable) -> Any:  # noqa: ANN401 (of the file)
    """Return a stream with the defaults of its kind, and what its codec and encoding become."""
    record = next((each for kind, each in STREAMS.items() if kind in written), None)
    if record is None:
        return written
    try:
        entry: dict[str, Any] = msgspec.to_builtins(msgspec.convert(written, record))
    except msgspec.ValidationError:
        return written
    stream = table.get(entry["id"])
    if stream is not None and stream.type is not None and entry.get("ros") is None:
        entry |= {"codec": stream.spec.codec, "encoding": stream.encoding}
    return entry


def _without_passwords(link: dict[str, Any]) -> dict[str, Any]:
    return {**link, "locator": without_secrets(link["locator"])}
