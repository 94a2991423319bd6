"""The key `allowed_topics` of a link: rmw_desert's own file of topics and their ids.

It is JSON with one table, ``{ "topics": { "/turtle1/pose": 3, … } }``, the same file on all nodes
of that middleware. It gives the streams their ids, so that these are written only once, and
discovery its ids, if it has them. This module refuses ids that rmw_desert would silently wrap or
confuse: one above 255, or one that two topics share.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.config.problems import Place, shown
from zacoustic.core.profiles.entities import DiscoverySpec
from zacoustic.core.profiles.rmw_desert.discovery import BEACON_TOPIC, REQUEST_TOPIC
from zacoustic.core.values.rmw_desert.messages import LAST_STREAM_ID

_MOST_BYTES: Final = 1 << 20
_KINDS: Final = ("topic", "service", "action")


class AllowedTopics(msgspec.Struct, frozen=True, kw_only=True):
    """The contents of the file."""

    file: str
    """Name of the file, as in the configuration."""
    ids: dict[str, int]
    """Id of each topic and service, 1…255, by ROS name."""

    def id_of(self, name: str) -> int | None:
        """Return the id of a name, with or without leading slash."""
        return self.ids.get(f"/{name.lstrip('/')}")

    def discovery(self, node_name: str) -> DiscoverySpec:
        """Return the file's settings for discovery."""
        return DiscoverySpec(
            beacon_id=self.ids.get(BEACON_TOPIC),
            request_id=self.ids.get(REQUEST_TOPIC),
            node_name="".join(each if each.isalnum() else "_" for each in node_name),
        )


def read_allowed_topics(place: Place, written: str, folder: Path) -> AllowedTopics:
    """Read the file that is named at `place`.

    Args:
        place: Place of the key.
        written: Name of the file.
        folder: Folder to which the name is relative.

    Raises:
        ConfigError: There is no such file, or it is not a file of rmw_desert.
    """
    content = place.content(folder, _MOST_BYTES)
    allowed = '{ "topics": { "/name": id, … } }'
    try:
        topics = msgspec.json.decode(content)["topics"]
        entries = dict(topics.items())
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        place.refuse(f"{written}: {error}", allowed=allowed)
    except (KeyError, TypeError, AttributeError):
        place.refuse(f"{written}: no table of topics", allowed=allowed)
    ids: dict[str, int] = {}
    for name, stream_id in entries.items():
        known = {of: each for each, of in ids.items()}
        if type(stream_id) is not int or not 0 <= stream_id <= LAST_STREAM_ID:
            place.refuse(
                f"{written}: {name} has id {shown(stream_id)}",
                allowed=f"1..{LAST_STREAM_ID}, 0 for a topic that is not sent",
            )
        if stream_id in known:
            place.refuse(
                f"{written}: {name} has id {stream_id}, which is that of {known[stream_id]}",
                allowed="an id of its own for each",
            )
        if stream_id:
            ids[f"/{name.lstrip('/')}"] = stream_id
    return AllowedTopics(file=written, ids=ids)


def give_ids(place: Place, topics: AllowedTopics) -> list[Any]:
    """Return the list of streams at `place` with the ids of the file.

    Raises:
        ConfigError: A stream is not in the file, or has another id there.
    """
    return [_give_id(each, each.written, topics) for each in place.items]


def _give_id(place: Place, entry: object, topics: AllowedTopics) -> object:
    if not isinstance(entry, Mapping):
        return entry
    kind = next((kind for kind in _KINDS if isinstance(entry.get(kind), str)), None)
    if kind is None:
        return entry
    stream_id = topics.id_of(entry[kind])
    if stream_id is None:
        place.at(kind).refuse(
            f'"{entry[kind]}" is not in {topics.file}', allowed=", ".join(topics.ids) or "nothing"
        )
    if entry.get("id", stream_id) != stream_id:
        place.at("id").refuse(
            allowed=f"{stream_id}, as {topics.file} has it", hint="id can be left out"
        )
    return {**entry, "id": stream_id}
