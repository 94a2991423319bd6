"""Plugin of pytest (`-p tests.durations`): keeps how long each test file took, for `make quick`.

The durations lie in pytest's cache. A run of single tests of a file, or one that was stopped, keeps
nothing: its sums would be too small.
"""

from collections import Counter
from typing import Final

import pytest

KEY: Final = "zacoustic/durations"


class Durations:
    """Sums of one run.

    Args:
        config: Of that run.
    """

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._sums_s: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add what a test, its preparation or its end took."""
        self._sums_s[report.nodeid.partition("::")[0]] += report.duration  # type: ignore[assignment]

    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        """Keep the sums beside those of earlier runs."""
        is_whole = exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED)
        if is_whole and not session.shouldstop and not session.shouldfail and self._cache:
            sums = {path: round(took_s, 2) for path, took_s in self._sums_s.items()}
            self._cache.set(KEY, {**self._cache.get(KEY, {}), **sums})

    @property
    def _cache(self) -> pytest.Cache | None:
        return getattr(self._config, "cache", None)


def pytest_configure(config: pytest.Config) -> None:
    """Begin, in the process that hears of all tests."""
    options = config.option
    is_part = options.keyword or options.markexpr or any("::" in each for each in config.args)
    if not hasattr(config, "workerinput") and not is_part:
        config.pluginmanager.register(Durations(config))
