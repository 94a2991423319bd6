"""Every advice to install works before zacoustic is on an index: from a checkout, with real extras.

Looked at is each `pip install` of the pages, the examples, the container file and the sources, and
what the sources make of names that they fill in. `tests/test_packaging.py` has pip carry them out.
"""

import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from tests.pages.blocks import PAGES, ROOT
from zacoustic.app.cli import absent_module
from zacoustic.text.installing import OURSELVES, with_extra

PROJECT: Final = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS: Final = frozenset(PROJECT["optional-dependencies"])
PUBLISHED: Final = frozenset(
    re.split(r"[<>=;\[ ]", requirement)[0] for requirement in PROJECT["dependencies"]
)
"""Packages of others that an index has."""
INVENTED: Final = frozenset({"zacoustic-wire"})
"""The reader's own link of docs/links.md."""
FILLED_IN: Final = {
    "zacoustic/text/installing.py": ("'.[{extra}]'",),
    "zacoustic/app/cli/__init__.py": ("{_PACKAGES.get(module, name)}",),
    "zacoustic/link/registry.py": (
        "--upgrade {_distribution(point)}",
        "{distribution}[{point.name.rpartition('.')[2]}]",
    ),
    "examples/deploy/Containerfile": ('--no-cache-dir ".[${EXTRAS}]"',),
}
"""Where the package or the extra is filled in later; the tests below fill it in."""

_EACH: Final = re.compile(r"pip install\b(?:(?!pip install\b)[^\n])*")
"""To the next one or the end of the line: a sentence may have two."""
_ADVICE: Final = re.compile(
    r"""pip[ ]install[ ]+
    (?P<options>(?:-[\w-]+[ ]+)*)
    (?P<what>'[^']*'|"[^"]*"|[^\s`'",;)]+)""",
    re.VERBOSE,
)


def files() -> list[Path]:
    found = [ROOT / page for page in (*PAGES, "CONTRIBUTING.md", "SECURITY.md")]
    for folder in ("zacoustic", "links", "examples", ".github"):
        found += [
            path for path in (ROOT / folder).rglob("*") if path.suffix not in (".pyc", ".png")
        ]
    return sorted(path for path in found if path.is_file())


def advised() -> Iterator[tuple[str, str]]:
    """Each advice with its file, those left out that are filled in later."""
    for path in files():
        name = path.relative_to(ROOT).as_posix()
        text = path.read_text(encoding="utf-8", errors="replace")
        for later in FILLED_IN.get(name, ()):
            assert f"pip install {later}" in text, (name, later)
            text = text.replace(f"pip install {later}", "")
        for found in _EACH.finditer(text):
            yield name, found[0]


def advised_packages() -> list[str]:
    """What follows `pip install`, each once; `tests/test_packaging.py` has pip look at each."""
    found = {_ADVICE.match(advice) for _, advice in advised()}
    return sorted({shlex.split(each["what"])[0] for each in found if each is not None})


def fault(advice: str) -> str:
    """Say what is wrong with a `pip install …`; empty: it works from a checkout."""
    found = _ADVICE.match(advice)
    if found is None:
        return "nothing to install"
    options = set(found["options"].split())
    if not options <= {"-e", "--editable", "--no-cache-dir", "--upgrade"}:
        return f"options {' '.join(sorted(options))}"
    (what,) = shlex.split(found["what"])
    package, bracket, rest = what.partition("[")
    if bracket and package == ".":
        if found["what"][0] not in "'\"":
            return "a shell may expand the bracket: quote it"
        unknown = set(rest.removesuffix("]").split(",")) - EXTRAS
        return f"no extra {', '.join(sorted(unknown))}" if unknown else ""
    return "" if package == "." or package in PUBLISHED | INVENTED else f"{package} is on no index"


def test_every_advice_to_install_works_from_a_checkout() -> None:
    found = [*advised()]
    assert len(found) > 15
    assert {f"{name}: {advice}": fault(advice) for name, advice in found if fault(advice)} == {}


@pytest.mark.parametrize(
    ("advice", "expected"),
    [
        ("pip install '.[ros,gateway]'", ""),
        ("pip install -e .", ""),
        ("pip install eclipse-zenoh)", ""),
        ("pip install 'zacoustic[ros]'", "zacoustic is on no index"),
        ("pip install zacoustic", "zacoustic is on no index"),
        ("pip install '.[rosy]'", "no extra rosy"),
        ("pip install .[ros]", "a shell may expand the bracket: quote it"),
        ("pip install --user .", "options --user"),
    ],
)
def test_an_advice_that_does_not_work_is_found(advice: str, expected: str) -> None:
    assert fault(advice) == expected


def test_what_the_sources_fill_in_is_an_extra() -> None:
    """The names that `with_extra` and `need_matplotlib` are called with."""
    call = re.compile(r"""(?:with_extra|need_matplotlib)\(["'](\w+)["']\)""")
    named = {
        extra
        for path in (ROOT / "zacoustic").rglob("*.py")
        for extra in call.findall(path.read_text(encoding="utf-8"))
    }
    assert len(named) > 5
    assert named <= EXTRAS
    assert fault(OURSELVES.partition(": ")[2]) == ""
    assert fault(with_extra("ros").partition(": ")[2]) == ""


@pytest.mark.parametrize(
    "module",
    [
        *(
            "cryptography",
            "dask",
            "distributed",
            "matplotlib",
            "mcap",
            "nicegui",
            "pyarrow",
            "rich",
        ),
        *("prometheus_client", "rosbags", "serial", "shtab", "xxhash", "zenoh", "cbor2", "json5"),
    ],
)
def test_an_absent_module_is_named_with_what_brings_it(module: str) -> None:
    (advice,) = re.findall(r"pip install .*(?=\))", absent_module(module))
    assert fault(advice) == ""


def test_the_extra_that_brings_a_module_lists_its_package() -> None:
    """So that who follows the advice has the module afterwards."""
    for module, package in (
        ("rich", "rich"),
        ("mcap", "mcap"),
        ("prometheus_client", "prometheus-client"),
    ):
        (extra,) = re.findall(r"\[(\w+)\]", absent_module(module))
        named = PROJECT["optional-dependencies"][extra]
        assert any(requirement.startswith(package) for requirement in named), module
