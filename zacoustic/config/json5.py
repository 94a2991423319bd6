"""JSON5 files, read by Zenoh's own parser: one grammar for all files of a user.

Zenoh's parser reads a whole `Config` with one free-form part, `metadata`; this module wraps a text
into that part and reads it back as JSON. Four properties of the parser show: keys come back sorted;
of duplicate keys only the last survives (so everything with an order or an identity is an array);
NaN and Infinity, which JSON lacks, come back as None; a character beyond U+FFFF must be written as
itself, because a pair of escapes becomes another character.

The text is parsed twice. The first pass reads the bare text, so that a syntax error has the line
and the column of the user's file, and so that no text can close the wrapper and write into the rest
of the config. The parser checks the grammar of the whole text before it looks at a field: errors of
the first pass about fields only mean that the text is not a Zenoh config, and are ignored.

Without Zenoh, a parser in Python reads the same texts, more slowly, and nothing checks the fields
that are Zenoh's own.
"""

import json
import math
import re
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Final

from zacoustic.errors import ConfigError

if TYPE_CHECKING:  # the import costs 20 ms and a shared library, which only readers of files pay
    import zenoh

ACOUSTIC_SECTION: Final = "plugins/acoustic"
"""Path of the gateway's section in a Zenoh config."""
DEPTH_LIMIT: Final = 200
"""Deepest nesting of objects and arrays; the parser's stack overflows somewhere above 5000."""

_BRACKET: Final = re.compile(r"[\[\]{}]")
_SECTION_HINT: Final = (
    "add plugins: { acoustic: { address: 1, links: [ { locator: ... } ], streams: [ ... ] } }"
)
_SCENARIO_HINT: Final = (
    "it looks like a scenario, which zacoustic sim, plan, medium and emulate take"
)
# The parser's words for an error of grammar, and for one of a field, which has no place in YAML.
_GRAMMAR: Final = re.compile(r"-->\s*(\d+):(\d+).*=\s*(.*)", re.DOTALL)
_FIELD: Final = re.compile(
    r'JSON error: Message \{ msg: "(.*)", location: '
    r"(?:None|Some\(Location \{ line: (\d+), column: (\d+) \}\))",
    re.DOTALL,
)
_PLAIN: Final = re.compile(r"<string>:(\d+) (.*) at column (\d+)", re.DOTALL)
_VALUE_AND_ENDS: Final = re.compile(
    r"""(?:"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|[\w.+-]+)(?:\s|//[^\n]*|/\*.*?\*/|[\]}])*""",
    re.DOTALL,
)
"""A value that is no list and no object, and what may follow it without a comma."""
_SHOWN: Final = 20
_WHERE_IN_ZENOH: Final = re.compile(r" at \S+\.rs:\d+\.?")
_OS_ERROR: Final = re.compile(r" \(os error \d+\)")


def parse_json5(text: str, *, source: str) -> object:
    """Parse a JSON5 text.

    Args:
        text: Any JSON5 value, with comments and trailing commas.
        source: Name of the file or of the argument, for the messages.

    Returns:
        Plain objects: dict with sorted keys, list, str, int, float, bool, None.

    Raises:
        ConfigError: The text is not JSON5; the message has source, line, column and what was
            expected.
    """
    _check_depth(text, source)
    zenoh = _zenoh()
    if zenoh is None:
        return _parse_without_zenoh(text, source)
    try:
        zenoh.Config.from_json5(text)
    except zenoh.ZError as error:
        if _GRAMMAR.search(str(error)):
            raise _config_error(error, source, text) from error
    try:
        # The line break ends a comment on the last line.
        wrapped = zenoh.Config.from_json5("{metadata:" + text + "\n}")
        return json.loads(wrapped.get_json("metadata"))
    except zenoh.ZError as error:
        raise _config_error(error, source, text) from error


def read_json5(path: str | Path) -> object:
    """Read and parse a JSON5 file, UTF-8.

    Raises:
        ConfigError: The file is missing, not readable or not JSON5.
    """
    return parse_json5(_read_text(path), source=str(path))


def read_zenoh_config(path: str | Path) -> "tuple[zenoh.Config | None, object]":
    """Read a Zenoh config file that has a section `plugins.acoustic`.

    Args:
        path: A `.json5`, `.json` or `.yaml` file.

    Returns:
        The config for `zenoh.open` (None if Zenoh is not installed), and the section as plain
        objects with sorted keys.

    Raises:
        ConfigError: The file is missing, not readable, not a Zenoh config, or has no such section.
    """
    text = _read_text(path)
    _check_depth(text, str(path))
    zenoh = _zenoh()
    if zenoh is None:
        return None, _section_without_zenoh(text, path)
    try:
        config = zenoh.Config.from_file(str(path))
    except zenoh.ZError as error:
        if _is_scenario(text):
            raise ConfigError(
                f"{path}: no section plugins.acoustic", hint=_SCENARIO_HINT
            ) from error
        raise _config_error(error, str(path), text) from error
    try:
        return config, json.loads(config.get_json(ACOUSTIC_SECTION))
    except zenoh.ZError as error:
        raise ConfigError(f"{path}: no section plugins.acoustic", hint=_SECTION_HINT) from error


def _zenoh() -> ModuleType | None:
    """Return Zenoh; None: it is not installed."""
    try:
        import zenoh
    except ModuleNotFoundError:
        return None
    return zenoh


def _section_without_zenoh(text: str, path: str | Path) -> object:
    """Find the section in a file that Zenoh cannot read.

    Raises:
        ConfigError: The text is not JSON5, or has no such section.
    """
    if Path(path).suffix in (".yaml", ".yml"):
        raise ConfigError(f"{path}: YAML is read by Zenoh", hint="pip install eclipse-zenoh")
    whole = _parse_without_zenoh(text, str(path))
    plugins = whole.get("plugins") if isinstance(whole, dict) else None
    if not isinstance(plugins, dict) or "acoustic" not in plugins:
        hint = _SCENARIO_HINT if _is_scenario(text) else _SECTION_HINT
        raise ConfigError(f"{path}: no section plugins.acoustic", hint=hint)
    return plugins["acoustic"]


def _parse_without_zenoh(text: str, source: str) -> object:
    import json5

    try:
        return _as_zenoh_has_it(json5.loads(text))
    except ValueError as error:
        found = _PLAIN.fullmatch(str(error))
        place = f":{found[1]}:{found[3]}" if found else ""
        hint = _comma_hint(text, int(found[1]), int(found[3])) if found else ""
        raise ConfigError(f"{source}{place}: {found[2] if found else error}", hint=hint) from None
    except RecursionError:
        raise ConfigError(f"{source}: nested too deep to be read without Zenoh") from None


def _as_zenoh_has_it(value: object) -> object:
    """Sort keys, and leave out values that JSON lacks."""
    if isinstance(value, dict):
        return {_text(key): _as_zenoh_has_it(value[key]) for key in sorted(value)}
    if isinstance(value, list):
        return [_as_zenoh_has_it(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return _text(value) if isinstance(value, str) else value


def _text(text: str) -> str:
    """Join a character written as two escapes; half of such a pair is no character."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def _is_scenario(text: str) -> bool:
    """Tell whether a text that is not a Zenoh config is another kind of our files."""
    try:
        found = parse_json5(text, source="")
    except ConfigError:
        return False
    return (
        isinstance(found, dict) and "plugins" not in found and isinstance(found.get("nodes"), list)
    )


def _read_text(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start} is not UTF-8") from error


def _check_depth(text: str, source: str) -> None:
    """Refuse nesting that would overflow the parser's stack and end the process.

    Brackets in strings and comments count too; real files do not come near the limit.
    """
    depth = 0
    for bracket in _BRACKET.finditer(text):
        depth += 1 if bracket.group() in "[{" else -1
        if depth > DEPTH_LIMIT:
            line = text.count("\n", 0, bracket.start()) + 1
            raise ConfigError(f"{source}:{line}: nested {depth} deep; allowed: {DEPTH_LIMIT}")


def _comma_hint(text: str, line: int, column: int) -> str:
    """Return what to do if a comma is missing behind a place, or nothing.

    The parser points at the last value before it, and says what else that could be.
    """
    lines = text.split("\n")
    if not 1 <= line <= len(lines):
        return ""
    rest = "\n".join([lines[line - 1][column - 1 :], *lines[line:]])
    found = _VALUE_AND_ENDS.match(rest)
    if found is None:
        return ""
    follows = rest[found.end() :].split("\n")[0].strip()
    begins = follows[:1].isalnum() or follows[:1] in {*"_$\"'{["}
    return f"is a comma missing before {follows[:_SHOWN]}?" if begins else ""


def _config_error(error: Exception, source: str, written: str) -> ConfigError:
    """Turn an error of Zenoh's parser into one line about the user's file."""
    text = _WHERE_IN_ZENOH.sub("", str(error))
    if grammar := _GRAMMAR.search(text):
        line, column, expected = grammar.groups()
        plain = expected.strip().replace("EOI", "the end of the file")
        hint = _comma_hint(written, int(line), int(column))
        return ConfigError(f"{source}:{line}:{column}: {plain}", hint=hint)
    if field := _FIELD.search(text):
        message, line, column = field.groups()
        place = f":{line}:{column}" if line else ""
        hint = _comma_hint(written, int(line), int(column)) if line else ""
        return ConfigError(f"{source}{place}: {' '.join(message.split())}", hint=hint)
    if "error parsing integer" in text or "error parsing number" in text:
        return ConfigError(f"{source}: a number is too large; allowed: 64 bits")
    return ConfigError(f"{source}: {' '.join(_OS_ERROR.sub('', text).split())}")
