"""Public names for links that read JSON5: `zacoustic.config.json5`."""

from zacoustic.config.json5 import (
    ACOUSTIC_SECTION,
    DEPTH_LIMIT,
    parse_json5,
    read_json5,
    read_zenoh_config,
)

__all__ = [
    "ACOUSTIC_SECTION",
    "DEPTH_LIMIT",
    "parse_json5",
    "read_json5",
    "read_zenoh_config",
]
