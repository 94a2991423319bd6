"""The configuration as a JSON Schema, for completion and checks in editors.

It is less strict than the reader: it omits conditions between keys.
"""

from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.reference.meanings import meanings_of
from zacoustic.app.tools.design.reference.tables import records
from zacoustic.config.reading import RATIO
from zacoustic.config.sections import STREAMS, Section
from zacoustic.text.allowed import allowed, table_of

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_FOR_ZENOH: Final = {"__required__": {"type": "boolean"}, "__path__": {}, "__plugin__": {}}


def json_schema() -> dict[str, Any]:
    """Return the schema of a whole file: Zenoh's keys are free, those of our section are not."""
    known = [record for _, record, _ in records()]
    _, components = msgspec.json.schema_components(known, ref_template="#/$defs/{name}")
    for record in known:
        _describe(components[record.__name__]["properties"], record)
    for stream in STREAMS.values():  # with rmw_desert, the ids may be in a file that a link names
        components[stream.__name__]["required"].remove("id")
    section = components[Section.__name__]
    section["properties"] |= _FOR_ZENOH
    kinds = [{"$ref": f"#/$defs/{stream.__name__}"} for stream in STREAMS.values()]
    section["properties"]["streams"]["items"] = {"anyOf": kinds}
    acoustic = {"$ref": f"#/$defs/{Section.__name__}"}
    return {
        "$schema": DIALECT,
        "title": "A Zenoh configuration with plugins.acoustic",
        "type": "object",
        "properties": {"plugins": {"type": "object", "properties": {"acoustic": acoustic}}},
        "$defs": components,
    }


def _describe(properties: dict[str, Any], record: type[msgspec.Struct]) -> None:
    meanings = meanings_of(record)
    for field in table_of(record).fields:
        entry, words = properties[field.encode_name], allowed(field.type)
        entry["description"] = f"{meanings.get(field.name, '')} Allowed: {words}."
        if "a ratio" in words:
            entry["anyOf"].append({"type": "string", "pattern": RATIO})
