import pytest

from tests.conformance.harnesses import HARNESSES, conditions
from tests.runtime.loop_checks import run
from zacoustic.link import registry
from zacoustic.testing.conformance import CHECKS, Check

CASES = [
    pytest.param(link, condition, check, id=f"{link}-{condition}-{check.__name__}")
    for link in registry.names()
    for condition in conditions(link)
    for check in CHECKS
]


def test_every_registered_link_has_a_harness() -> None:
    assert set(registry.names()) == set(HARNESSES)
    assert all(HARNESSES.values())


@pytest.mark.parametrize(("link", "condition", "check"), CASES)
def test_link_keeps_the_contract(link: str, condition: str, check: Check) -> None:
    run(check(HARNESSES[link][condition]()), limit_s=60.0)
