"""The key `metrics`: where a gateway answers Prometheus."""

import re
from typing import Final

from zacoustic.config.sections import Section
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import allowed, find, table_of

LOOPBACK: Final = "127.0.0.1"
"""Host if only a port is given: the gateway answers this computer only."""

_PLACE: Final = re.compile(r"(?:(\[[^\]]+\]|[^:\[\]\s]+):)?([0-9]{1,5})")
_LAST_PORT: Final = 65_535


def parse_metrics(written: str) -> tuple[str, int] | None:
    """Return host and port of ``PORT`` or ``HOST:PORT``; None: the text is neither."""
    found = _PLACE.fullmatch(written)
    if found is None or int(found[2]) > _LAST_PORT:
        return None
    return (found[1] or LOOPBACK).strip("[]"), int(found[2])


def metrics_argument(written: str | None) -> tuple[str, int] | None:
    """Read the argument `--metrics`; None: it is not given.

    Raises:
        ConfigError: The argument is not a place.
    """
    if written is None:
        return None
    found = parse_metrics(written)
    if found is None:
        kind = find(table_of(Section), ["metrics"])
        assert kind is not None
        raise ConfigError(f'--metrics "{written}"; allowed: {allowed(kind)}')
    return found
