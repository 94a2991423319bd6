"""A section of the configuration with something of everything, to be changed."""

import copy
from typing import Any, get_args

import msgspec
import pytest

from zacoustic.config import config_from_mapping, sections
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.errors import ConfigError

RECORDS: list[type[msgspec.Struct]] = [
    *(
        each
        for each in vars(sections).values()
        if isinstance(each, type)
        and issubclass(each, msgspec.Struct)
        and each is not sections.Entry
    ),
    *get_args(AccessSpec),
]
"""Records of the tables of a file."""

ROOT = "fleet.json5: plugins.acoustic"
"""Where a mistake in a section is."""

SECTION: dict[str, Any] = {
    "__required__": False,
    "address": 2,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "links": [{"locator": "sim/127.0.0.1:7000#mtu=64"}],
    "types": [
        {
            "name": "Nav",
            "fields": [
                {"name": "lat", "type": "float64", "range": [-90, 90], "step": 1e-6},
                {"name": "mode", "type": "enum", "values": ["idle", "survey"]},
                {"name": "at", "type": "Point", "optional": True},
            ],
        },
        {"name": "Point", "fields": [{"name": "x", "type": "float32", "unit": "m"}]},
        {"name": "Arm", "fields": []},
    ],
    "streams": [
        {
            "id": 10,
            "topic": "auv1/nav",
            "type": "Nav",
            "publishers": [2],
            "subscribers": [1],
            "priority": "real_time",
            "depth": 3,
            "lifespan_s": 60,
            "deadline_s": 90,
            "min_interval_s": 0.5,
            "linger_s": 2,
            "stamp": "age",
            "encoding": "application/json",
            "codec": "cbor",
            "reliability": "best_effort",
            "durability": "volatile",
            "forward": "always",
        },
        {
            "id": 11,
            "topic": "fleet/{node}/{sensor}",
            "wildcards": [{"name": "sensor", "values": ["ctd", "usbl"]}],
        },
        {
            "id": 20,
            "service": "auv1/arm",
            "request": "Arm",
            "response": "Arm",
            "server": 2,
            "timeout_s": 90,
            "priority": "interactive_high",
        },
    ],
    "lost_contact": [],
    "ranging": [{"by": 2, "to": 1, "every_s": 30}],
}


def changed(path: str, value: object) -> dict[str, Any]:
    """The section with one value changed, added or (`...`) taken out."""
    section = copy.deepcopy(SECTION)
    steps: list[Any] = [int(step) if step.isdigit() else step for step in path.split(".")]
    target: Any = section
    for step in steps[:-1]:
        target = target[step]
    if value is ...:
        del target[steps[-1]]
    elif isinstance(target, list) and steps[-1] == len(target):
        target.append(value)
    else:
        target[steps[-1]] = value
    return section


def message_of(section: object, **given: Any) -> str:
    with pytest.raises(ConfigError) as caught:
        config_from_mapping(section, source="fleet.json5", **given)
    return str(caught.value)
