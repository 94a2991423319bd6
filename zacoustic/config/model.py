"""The key `model`: the fitted model of the dense streams, from a separate file."""

from pathlib import Path

import msgspec

from zacoustic.config.problems import Place
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.dense import DenseCodec, Model
from zacoustic.errors import ConfigError

_MOST_BYTES = 1 << 24


class ModelFile(msgspec.Struct, frozen=True, kw_only=True):
    """The content of a model file."""

    model: Model
    """The fitted model of the dense streams."""
    typical_bits: dict[str, float] = {}
    """Typical bits of a sample as the fit has measured them, by stream id as text. For people and
    planners; both ends need not agree on them."""


def read_model(place: Place, written: str | None, folder: Path) -> ModelFile | None:
    """Read the model file; None: none is named.

    Args:
        place: Place of the key.
        written: Name of the file.
        folder: Folder to which the name is relative.

    Raises:
        ConfigError: There is no such file, or it has no model.
    """
    if written is None:
        return None
    content = place.content(folder, _MOST_BYTES)
    try:
        return msgspec.json.decode(content, type=ModelFile, strict=True)
    except (msgspec.DecodeError, RecursionError) as error:
        place.refuse(f"{written}: no model: {error}", allowed=place.allowed, hint=place.hint)


def check_model(place: Place, table: StreamTable) -> None:
    """Check that a model was fitted to the dense streams of a table.

    Raises:
        ConfigError: It was not.
    """
    types = {each.stream_id: each.dense_type for each in table if each.dense_type is not None}
    if table.model is None:
        return
    if not types:
        place.refuse("no stream is dense", allowed='streams with codec: "dense"')
    strangers = [name for name in table.model.streams if name not in map(str, types)]
    if strangers:
        place.refuse(
            f"has streams that are not dense here: {', '.join(strangers)}", hint=place.hint
        )
    try:
        DenseCodec(types, model=table.model)
    except ConfigError as error:
        place.refuse(str(error.args[0]), hint=error.hint or place.hint)
