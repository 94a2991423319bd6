"""What verbs that serve share; stopping and lines are tested with the verbs."""

import errno
import math
import socket

import pytest

from zacoustic.errors import ConfigError
from zacoustic.link.serving import ScaledClock, cannot_listen, parse_place, place_name


@pytest.mark.parametrize(
    ("text", "place"), [("127.0.0.1:0", ("127.0.0.1", 0)), ("[::1]:9200", ("::1", 9200))]
)
def test_place_is_written_as_it_is_read(text: str, place: tuple[str, int]) -> None:
    assert parse_place(text) == place
    assert place_name(*place) == text


def test_place_that_cannot_be_listened_at_says_why_and_who_may_be_there() -> None:
    error = cannot_listen("::1", 9200, OSError(errno.EADDRINUSE, "in use"), rival="a modem")
    assert str(error).startswith("cannot listen at [::1]:9200: Address already in use")
    assert error.hint == "a modem may be running; port 0 takes any that is free"
    name = cannot_listen("nowhere", 1, socket.gaierror(-2, "not known"), rival="a modem")
    assert str(name).startswith("cannot listen at nowhere:1: not known")


def test_scaled_clock_begins_at_nothing_and_runs_faster() -> None:
    now = [5_000]
    clock = ScaledClock(10.0, lambda: now[0])
    assert clock.now() == 0
    now[0] += 70
    assert clock.now() == 700


@pytest.mark.parametrize("time_scale", [0.0, -1.0, math.inf, math.nan])
def test_time_that_does_not_pass_is_refused(time_scale: float) -> None:
    with pytest.raises(ConfigError, match="allowed: above 0"):
        ScaledClock(time_scale)
