"""One test in two sizes: a small share of its count in `make test`, all of it in `make soak`.

Ways to write such a test; `ZACOUSTIC_SOAK=1` turns on the full size of each:

- a Hypothesis test without a `max_examples` of its own takes the number from the profile;
- a test that repeats something takes the fixture `count`: `for seed in range(count(10_000)):`;
- a test for which such a share is too little, or too much, takes the fixture `sized` and names both
  sizes: `for minute in range(sized(24 * 60, share=6 * 60)):`;
- a test that makes sense at full size only carries the mark `soak`, and is deselected otherwise; so
  does a parameter of a test (`pytest.param(…, marks=pytest.mark.soak)`) whose others go the same
  ways at less cost.

`make soak` selects by the mark; the first three kinds get it here. A test with the mark `hardware`
is skipped unless `ZACOUSTIC_HW` names a modem.
"""

import gc
import math
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import hypothesis
import pytest

SOAK: Final = os.environ.get("ZACOUSTIC_SOAK", "") not in ("", "0")
EXAMPLES: Final = 25
"""Examples of a Hypothesis test in `make test`."""
SOAK_EXAMPLES: Final = 1_000
SHARE: Final = 200
"""`make test` repeats one of so many times."""
_LONGEST: Final = ("test_pages.py", "test_packaging.py", "test_examples.py")

# No deadline per example: it would measure how busy the machine is.
hypothesis.settings.register_profile(
    "share", max_examples=EXAMPLES, derandomize=True, deadline=None
)
hypothesis.settings.register_profile(
    "soak", max_examples=SOAK_EXAMPLES, print_blob=True, deadline=None
)
hypothesis.settings.load_profile("soak" if SOAK else "share")


@pytest.fixture(scope="session")
def count() -> Callable[[int], int]:
    """Give how often to repeat: a share of the full count, at least once; all in a soak."""

    def share(full: int) -> int:
        return full if SOAK else math.ceil(full / SHARE)

    return share


@pytest.fixture(scope="session")
def sized() -> Callable[..., int]:
    """Give one of two sizes: `sized(full, share=...)`."""

    def one(full: int, *, share: int) -> int:
        return full if SOAK else share

    return one


def pytest_configure(config: pytest.Config) -> None:
    """Give tests, and all programs that they start, a home of their own.

    Libraries write settings and caches into the home, one of them even into git's configuration.
    Processes of pytest-xdist inherit the home of the one that has started them.
    """
    if hasattr(config, "workerinput"):
        return
    home = Path(tempfile.mkdtemp(prefix="zacoustic-home-"))
    config.add_cleanup(lambda: shutil.rmtree(home, ignore_errors=True))
    # What is read of the user's: where pip finds an index, and whose checkouts git trusts.
    for name in (".config/pip/pip.conf", ".gitconfig"):
        if (settings := Path.home() / name).exists():
            (home / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(settings, home / name)
    os.environ.setdefault("PIP_CACHE_DIR", str(Path(__file__).parents[1] / ".venv-cache" / "pip"))
    os.environ["HOME"] = str(home)
    for name in ("XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME"):
        os.environ.pop(name, None)


# Engines make many objects of which few go in circles: to look for circles so often takes time.
gc.set_threshold(50_000, 20, 20)


# First of all, since `-m soak` selects by the marks that are given here.
@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    deselected = [item for item in items if not SOAK and item.get_closest_marker("soak")]
    if deselected:
        config.hook.pytest_deselected(items=deselected)
        items[:] = [item for item in items if not item.get_closest_marker("soak")]
    for item in items:
        if SOAK and _has_two_sizes(item):
            item.add_marker("soak")
        if item.get_closest_marker("hardware") and not os.environ.get("ZACOUSTIC_HW"):
            item.add_marker(pytest.mark.skip(reason="ZACOUSTIC_HW names no modem"))
    # These take longest: they go first, so that no worker waits for one at the end.
    items.sort(key=lambda item: item.path.name not in _LONGEST)


def _has_two_sizes(item: pytest.Item) -> bool:
    return isinstance(item, pytest.Function) and (
        "count" in item.fixturenames
        or "sized" in item.fixturenames
        or hypothesis.is_hypothesis_test(item.obj)
    )
