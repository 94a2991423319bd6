"""The table `objects`: bounds of the memory for samples larger than a frame."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import ObjectsEntry
from zacoustic.core.transport.objects.limits import MOST_BYTES, ObjectLimits
from zacoustic.core.wire.objects import MOST_TRANSFERS

_DEFAULT = ObjectLimits()


def read_objects(place: Place, entry: ObjectsEntry | None) -> ObjectLimits:
    """Read the table at `place`.

    Args:
        place: Place of the table.
        entry: Its content, or None.

    Raises:
        ConfigError: A number is out of its range.
    """
    if entry is None:
        return _DEFAULT
    _check(place.at("max_bytes"), entry.max_bytes, 1, MOST_BYTES)
    _check(place.at("max_waiting"), entry.max_waiting, 1, MOST_TRANSFERS)
    most_bytes = _DEFAULT.largest_bytes if entry.max_bytes is None else entry.max_bytes
    _check(place.at("memory_bytes"), entry.memory_bytes, most_bytes, 1 << 32)
    memory_bytes = max(_DEFAULT.incoming_bytes, most_bytes)
    return ObjectLimits(
        largest_bytes=most_bytes,
        most_outgoing=entry.max_waiting or _DEFAULT.most_outgoing,
        incoming_bytes=entry.memory_bytes or memory_bytes,
    )


def _check(place: Place, written: int | None, least: int, most: int) -> None:
    if written is not None and not least <= written <= most:
        why = "" if least == 1 else ", not less than max_bytes"
        place.refuse(allowed=f"{least}..{most}{why}")
