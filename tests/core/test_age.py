"""Age: one byte says how old a sample is."""

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.values.age import (
    NO_AGE,
    OLDER,
    OLDEST_S,
    UNKNOWN,
    Age,
    age_words,
    decode_age,
    encode_age,
)

DAY_NS = 86_400 * NS_PER_S


def decoded_s(code: int) -> float:
    seconds = decode_age(code).seconds
    assert seconds is not None
    return seconds


def test_every_code_is_that_of_its_own_age() -> None:
    for code in range(OLDER):
        assert encode_age(seconds_to_ns(decoded_s(code))) == code


def test_ages_grow_with_their_codes() -> None:
    ages_s = [decoded_s(code) for code in range(OLDER)]
    assert ages_s == sorted(set(ages_s))
    assert ages_s[:3] == [0.0, 0.1, 0.2]
    assert (ages_s[100], ages_s[253]) == (10.0, 30 * 86_400.0)


def test_more_than_thirty_days_is_older_and_a_negative_age_is_none() -> None:
    assert encode_age(30 * DAY_NS) == 253
    assert encode_age(30 * DAY_NS + 1) == OLDER
    assert encode_age(10**30) == OLDER
    assert encode_age(-1) == encode_age(-(10**30)) == 0
    assert decode_age(OLDER) == Age(OLDEST_S, None), "it may be any time older"


def test_unknown_age_stays_unknown() -> None:
    assert encode_age(None) == UNKNOWN
    assert decode_age(UNKNOWN) == NO_AGE == NO_AGE.later(3600.0)


@given(st.integers(0, 10 * NS_PER_S))
def test_first_ten_seconds_are_exact_to_a_twentieth_of_a_second(age_ns: int) -> None:
    assert abs(decoded_s(encode_age(age_ns)) - age_ns / NS_PER_S) <= 0.05 + 1e-9


@given(st.integers(10 * NS_PER_S, 30 * DAY_NS))
def test_later_ages_are_right_to_four_percent(age_ns: int) -> None:
    age_s = age_ns / NS_PER_S
    assert abs(decoded_s(encode_age(age_ns)) - age_s) <= 0.0408 * age_s


@given(st.integers(0, 30 * DAY_NS))
def test_no_age_is_further_off_than_its_error_says(age_ns: int) -> None:
    age = decode_age(encode_age(age_ns))
    assert age.seconds is not None
    assert age.error_s is not None
    assert abs(age.seconds - age_ns / NS_PER_S) <= age.error_s + 1e-3


@given(st.integers(-NS_PER_S, 60 * DAY_NS), st.integers(0, DAY_NS))
def test_older_never_gets_a_smaller_code(age_ns: int, more_ns: int) -> None:
    assert encode_age(age_ns) <= encode_age(age_ns + more_ns)


def test_time_that_passes_adds_to_age_and_error() -> None:
    assert Age(1.0, 0.05).later(0.5, 0.25) == Age(1.5, 0.3)
    assert Age(1.0, 0.05).later(2.0) == Age(3.0, 0.05)
    assert Age(1.0, 0.05).later(2.0, None) == Age(3.0, None)
    assert Age(OLDEST_S, None).later(5.0) == Age(OLDEST_S + 5, None)


def test_ages_in_words() -> None:
    assert age_words(1.26, 0.06) == "1.3 s old"
    assert age_words(1.26, 0.55) == "1.3 s old ± 0.6 s"
    assert age_words(None) == "age unknown"
    assert age_words(OLDEST_S + 3) == "over 30 days old"
