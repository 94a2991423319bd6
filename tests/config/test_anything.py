"""Whatever is read as a section is a configuration, or one line of complaint."""

import copy
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.config.section import RECORDS, SECTION
from zacoustic.config import config_from_mapping
from zacoustic.errors import ConfigError

NAMES = sorted({name for record in RECORDS for name in record.__struct_encode_fields__})
KEYS = st.sampled_from(NAMES) | st.text(max_size=5)
JSON_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(["Nav", "enum", "float32", "best_effort", "a/{node}", "data"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=12,
)


def read_or_refuse(section: object) -> None:
    try:
        config = config_from_mapping(section, source="x")
    except ConfigError as error:
        message = str(error)
        if "\n" in message or not message.startswith("x: plugins.acoustic"):
            raise AssertionError(message) from error
    else:
        assert config.table.digest


@settings(deadline=None)
@given(JSON_VALUES | st.dictionaries(KEYS, JSON_VALUES, max_size=5))
def test_anything_is_a_config_or_a_config_error(section: object) -> None:
    read_or_refuse(section)


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_any_change_of_a_section_is_a_config_or_a_config_error(data: st.DataObject) -> None:
    section: Any = copy.deepcopy(SECTION)
    for _ in range(data.draw(st.integers(1, 2))):
        target: Any = section
        while True:
            keys = list(target) if isinstance(target, dict) else list(range(len(target)))
            if not keys:
                break
            key = data.draw(st.sampled_from(keys))
            inner = target[key]
            if isinstance(inner, dict | list) and inner and data.draw(st.integers(0, 3)):
                target = inner
                continue
            target[key] = data.draw(JSON_VALUES)
            break
        if isinstance(target, dict) and data.draw(st.booleans()):
            target[data.draw(KEYS)] = data.draw(JSON_VALUES)
    read_or_refuse(section)
