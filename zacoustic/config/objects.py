"""The table `objects`: bounds of the memory for samples larger than a frame."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import ObjectsEntry
from zacoustic.core.transport.objects.limits import ObjectLimits

_DEFAULT = ObjectLimits()


def read_objects(place: Place, entry: ObjectsEntry | None) -> ObjectLimits:
    """Read the table at `place`.

    Args:
        place: Place of the table.
        entry: Its content, or None.

    Raises:
        ConfigError: The memory holds no object of the largest size.
    """
    if entry is None:
        return _DEFAULT
    most_bytes = entry.max_bytes or _DEFAULT.largest_bytes
    if entry.memory_bytes is not None and entry.memory_bytes < most_bytes:
        place.at("memory_bytes").refuse(allowed=f"{most_bytes} or more, not less than max_bytes")
    return ObjectLimits(
        largest_bytes=most_bytes,
        most_outgoing=entry.max_waiting or _DEFAULT.most_outgoing,
        incoming_bytes=entry.memory_bytes or max(_DEFAULT.incoming_bytes, most_bytes),
    )
