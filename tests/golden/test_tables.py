"""The tables of the vectors, and their digests for a reader with the file and SHA-256 alone."""

import hashlib
import json
from typing import Any

import pytest

from tests.golden.tables import TABLES_FILE, text
from tests.golden.vectors import VECTORS

FILE: dict[str, Any] = json.loads(TABLES_FILE.read_text(encoding="utf-8"))


def digest_of(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).digest()[:4].hex()


def test_file_is_written_as_the_script_writes_it() -> None:
    assert TABLES_FILE.read_text(encoding="utf-8") == text()


@pytest.mark.parametrize("name", FILE["tables"])
def test_digests_are_those_of_the_descriptions(name: str) -> None:
    table = FILE["tables"][name]
    for stream in table["streams"]:
        assert stream["digest"] == digest_of(stream["description"].encode())
    streams = sorted(table["streams"], key=lambda each: each["id"])
    digests = [bytes.fromhex(each["digest"]) for each in streams]
    assert table["digest"] == digest_of(table["nodes_description"].encode(), *digests)
    nodes = [[int(address), node] for address, node in table["nodes"].items()]
    assert json.loads(table["nodes_description"]) == nodes


def test_digests_of_built_in_streams_are_those_of_their_descriptions() -> None:
    for stream in FILE["built_in"]:
        assert stream["digest"] == digest_of(stream["description"].encode())


@pytest.mark.parametrize("name", FILE["tables"])
def test_descriptions_follow_from_the_other_keys(name: str) -> None:
    """Written from docs/wire.md alone, with nothing of `zacoustic`."""
    table = FILE["tables"][name]
    types = {each["name"]: each for each in table["types"]}
    nodes = [[int(address), node] for address, node in table["nodes"].items()]
    for stream in table["streams"]:
        assert json.loads(stream["description"]) == described(stream, types, nodes)


def test_descriptions_of_types_follow_from_their_fields() -> None:
    for table in FILE["tables"].values():
        types = {each["name"]: each for each in table["types"]}
        for each in table["types"]:
            assert each["description"] == type_description(each["name"], types)
    types = {each["name"]: each for each in FILE["built_in_types"]}
    for each in FILE["built_in_types"]:
        assert each["description"] == type_description(each["name"], types)


def test_the_description_on_the_wire_page_has_the_digest_that_stands_there() -> None:
    page = (TABLES_FILE.parents[2] / "docs" / "wire.md").read_text(encoding="utf-8")
    example = page[page.index(' ["topic",7,') :]
    shown = "".join(line[1:] for line in example.partition("```")[0].splitlines())
    assert f"the digest `{digest_of(shown.encode())}`" in page


def test_vectors_name_tables_that_are_there() -> None:
    vectors = json.loads(VECTORS.read_text(encoding="utf-8"))
    assert {each["table"] for each in vectors} <= set(FILE["tables"])


def described(stream: dict[str, Any], types: dict[str, Any], nodes: list[Any]) -> list[Any]:
    """Return the list of section 8."""

    def shown(key: str) -> str | None:
        return None if stream[key] is None else type_description(stream[key], types)

    first, last = {
        "topic": ("type", "type"),
        "service": ("request", "response"),
        "action": ("goal", "result"),
    }[stream["kind"]]
    found = [stream["kind"], stream["id"], stream["name"], [shown(first), shown(last)]]
    found.append(stream["encoding"])
    if stream["codec"] != "cbor":
        found.append("codec dense 3" if stream["codec"] == "dense" else f"codec {stream['codec']}")
    if stream["kind"] == "service":
        return [*found, stream["server"], stream["timeout_s"]]
    if stream["kind"] == "action":
        times = [stream["timeout_s"], stream["result_timeout_s"]]
        return [*found, shown("feedback"), stream["server"], *times]
    ends = [stream["publishers"], stream["subscribers"]]
    found.append([None if each is None else sorted(each) for each in ends])
    found.append([[each["name"], *each["values"]] for each in stream["wildcards"]])
    found.append(nodes if "{node}" in stream["name"] else [])
    found.append(stream["stamp"])
    if stream["reliability"] == "reliable":
        found += ["reliable", stream["depth"]]
    if stream["forward"] == "on_demand":
        found.append("on_demand")
    return found


def type_description(name: str, types: dict[str, Any]) -> str:
    """Return the JSON text of a type: those that it uses come before it."""
    found: list[str] = []
    describe(name, types, found)
    return f"[{','.join(found)}]"


def describe(name: str, types: dict[str, Any], found: list[str]) -> int:
    fields = types[name]["fields"]
    used = dict.fromkeys(each["type"] for each in fields if each["type"] in types)
    places = {each: describe(each, types, found) for each in used}
    described = [
        [
            each["name"],
            places.get(each["type"], each["type"]),
            each.get("range"),
            each.get("step"),
            each.get("wraps", False),
            each.get("values", []),
            each.get("length"),
            each.get("max_length"),
            each.get("optional", False),
            *(["escape"] if each.get("outside") == "escape" else []),
        ]
        for each in fields
    ]
    text = json.dumps(described, separators=(",", ":"))
    if text not in found:
        found.append(text)
    return found.index(text)
