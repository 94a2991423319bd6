"""The configuration as a JSON Schema, for completion and checks in editors.

It is less strict than the reader: it omits conditions between keys.
"""

from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.reference.limits import limit
from zacoustic.app.tools.design.reference.meanings import meanings_of
from zacoustic.config.problems import allowed_at
from zacoustic.config.sections import RECORDS, ActionEntry, ServiceEntry, TopicEntry
from zacoustic.core.schedule.access.spec import METHODS

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_STREAMS: Final = (TopicEntry, ServiceEntry, ActionEntry)
_FOR_ZENOH: Final = {"__required__": {"type": "boolean"}, "__path__": {}, "__plugin__": {}}


def json_schema() -> dict[str, Any]:
    """Return the schema of a whole file: Zenoh's keys are free, those of our section are not."""
    records: list[type[Any]] = [*RECORDS.values(), *_STREAMS, *METHODS.values()]
    _, components = msgspec.json.schema_components(records, ref_template="#/$defs/{name}")
    paths: dict[type[Any], str] = {record: place for place, record in RECORDS.items()}
    paths |= dict.fromkeys(METHODS.values(), "links.access")
    for record in records:
        _describe(components[record.__name__], record, paths.get(record, "streams"))
    for stream in _STREAMS:  # with rmw_desert, the ids may be in a file that a link names
        components[stream.__name__]["required"].remove("id")
    section = components[RECORDS[""].__name__]
    section["properties"] |= _FOR_ZENOH
    section["properties"]["streams"]["items"] = _any_of(_STREAMS)
    link = components[RECORDS["links"].__name__]
    link["properties"]["access"] = _any_of(tuple(METHODS.values()))
    acoustic = {"$ref": f"#/$defs/{RECORDS[''].__name__}"}
    return {
        "$schema": DIALECT,
        "title": "A Zenoh configuration with plugins.acoustic",
        "type": "object",
        "properties": {"plugins": {"type": "object", "properties": {"acoustic": acoustic}}},
        "$defs": components,
    }


def _any_of(records: tuple[type[Any], ...]) -> dict[str, Any]:
    return {"anyOf": [{"$ref": f"#/$defs/{record.__name__}"} for record in records]}


def _describe(schema: dict[str, Any], record: type[msgspec.Struct], path: str) -> None:
    meanings = meanings_of(record)
    for field in msgspec.structs.fields(record):
        said = meanings.get(field.name, "")
        allowed = allowed_at(f".{path}.{field.encode_name}")
        entry = schema["properties"][field.encode_name]
        limit(entry, allowed, is_topic=record is TopicEntry)
        entry["description"] = f"{said} Allowed: {allowed}." if allowed else said
