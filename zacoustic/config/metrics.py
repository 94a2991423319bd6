"""The keys `metrics` and `metrics_names`: where a gateway answers Prometheus."""

import re
from typing import Final

from zacoustic.config.problems import Place
from zacoustic.config.sections import ALLOWED
from zacoustic.errors import ConfigError

LOOPBACK: Final = "127.0.0.1"
"""Host if only a port is given: the gateway answers this computer only."""

_PLACE: Final = re.compile(r"(?:(\[[^\]]+\]|[^:\[\]\s]+):)?([0-9]{1,5})")
_NAME: Final = re.compile(r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*")
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
        raise ConfigError(f'--metrics "{written}"; allowed: {ALLOWED["metrics"]}')
    return found


def read_metrics(place: Place, written: str | None) -> tuple[str, int] | None:
    """Read the key; None: metrics are off.

    Raises:
        ConfigError: The value is not a place.
    """
    if written is None:
        return None
    found = parse_metrics(written)
    if found is None:
        place.refuse(allowed=ALLOWED["metrics"])
    return found


def read_metrics_names(place: Place, written: tuple[str, ...]) -> tuple[str, ...]:
    """Read the key.

    Raises:
        ConfigError: A value is no host name.
    """
    for index, name in enumerate(written):
        if _NAME.fullmatch(name) is None:
            place.at(index).refuse(allowed=ALLOWED["metrics_names"])
    return written
