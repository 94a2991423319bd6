"""Age: one byte says how old a sample is."""

import math

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.values.age import OLDER, decode_age_s, encode_age

HOUR_NS = 3600 * NS_PER_S


def test_every_code_is_that_of_its_own_age() -> None:
    for code in range(OLDER):
        assert encode_age(seconds_to_ns(decode_age_s(code))) == code


def test_ages_grow_with_their_codes() -> None:
    ages_s = [decode_age_s(code) for code in range(256)]
    assert ages_s == sorted(set(ages_s))
    assert ages_s[:3] == [0.0, 0.1, 0.2]
    assert (ages_s[100], ages_s[254], ages_s[255]) == (10.0, 3600.0, math.inf)


def test_more_than_an_hour_is_older_and_a_negative_age_is_none() -> None:
    assert encode_age(HOUR_NS) == 254
    assert encode_age(HOUR_NS + 1) == OLDER
    assert encode_age(10**30) == OLDER
    assert encode_age(-1) == encode_age(-(10**30)) == 0


@given(st.integers(0, 10 * NS_PER_S))
def test_first_ten_seconds_are_exact_to_a_twentieth_of_a_second(age_ns: int) -> None:
    assert abs(decode_age_s(encode_age(age_ns)) - age_ns / NS_PER_S) <= 0.05 + 1e-9


@given(st.integers(10 * NS_PER_S, HOUR_NS))
def test_later_ages_are_right_to_two_percent(age_ns: int) -> None:
    age_s = age_ns / NS_PER_S
    assert abs(decode_age_s(encode_age(age_ns)) - age_s) <= 0.0197 * age_s


@given(st.integers(-NS_PER_S, 2 * HOUR_NS), st.integers(0, HOUR_NS))
def test_older_never_gets_a_smaller_code(age_ns: int, more_ns: int) -> None:
    assert encode_age(age_ns) <= encode_age(age_ns + more_ns)
