"""Log messages as JSON, one object a line, for log collectors.

Each object has ``time`` (UTC, ms), ``level``, ``logger`` and ``message``. Further members are
fields of the message, such as those of a gateway's notice, and ``exception``, a traceback.
"""

import logging
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final

import msgspec

from zacoustic.text.safetext import json_line, without_secrets

FIELDS: Final = "fields"
"""Name of the extra of a log record that holds its fields."""
_OWN: Final = ("time", "level", "logger", "message", "exception")


class JsonFormatter(logging.Formatter):
    """Writes a record as one line of JSON.

    Args:
        common: Fields of all messages.
    """

    def __init__(self, common: Mapping[str, object]) -> None:
        super().__init__()
        self._common = common

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        at = datetime.fromtimestamp(record.created, UTC)
        fields = {**self._common, **getattr(record, FIELDS, {})}
        line: dict[str, Any] = {
            "time": at.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **{name: value for name, value in fields.items() if name not in _OWN},
        }
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return without_secrets(json_line(msgspec.to_builtins(line, str_keys=True, enc_hook=str)))


def log_as_json(common: Mapping[str, object]) -> None:
    """Write all log messages, from INFO on, as JSON to standard error.

    Args:
        common: Fields of all messages.
    """
    handler = logging.StreamHandler()
    handler.setFormatter(JsonFormatter(common))
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)
