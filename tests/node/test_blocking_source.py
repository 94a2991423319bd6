"""The blocking API is made from the asynchronous one: the committed source is a fresh one."""

import ast
import inspect
from types import ModuleType
from typing import Any, Final

import pytest

import zacoustic
from tests.pages.test_repository import script
from zacoustic import blocking

OTHER_NAMES: Final = {
    "Delivery": {"__await__": "wait"},
    "Subscription": {"__aiter__": "__iter__", "__anext__": "__next__"},
    "Node": {"__aenter__": "__enter__", "__aexit__": "__exit__"},
}


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    return script("blockingapi")


def test_the_committed_source_is_a_fresh_one(generator: ModuleType) -> None:
    """Apart from the format, of which lint takes care."""
    committed = generator.TARGET.read_text("utf-8")
    same = ast.dump(ast.parse(committed)) == ast.dump(ast.parse(generator.generate()))
    assert same, "zacoustic/blocking.py is not what the asynchronous API makes it: make blocking"


@pytest.mark.parametrize("name", blocking.__all__)
def test_a_program_finds_every_member_under_its_asynchronous_name(
    generator: ModuleType, name: str
) -> None:
    there, here = getattr(zacoustic, name), getattr(blocking, name)
    inside = generator.INSIDE.get(name, set()) - {"open", "close"}
    others = OTHER_NAMES.get(name, {})
    known = {each for each in vars(there) if not each.startswith("_")} - inside
    assert known | set(others) <= set(dir(there))
    absent = [each for each in known if not hasattr(here, each)]
    absent += [each for each in others.values() if not hasattr(here, each)]
    assert absent == []


@pytest.mark.parametrize("name", blocking.__all__)
def test_calls_take_what_their_asynchronous_forms_take(name: str) -> None:
    there, here = getattr(zacoustic, name), getattr(blocking, name)
    for member, function in inspect.getmembers(here, inspect.isfunction):
        original: Any = inspect.getattr_static(there, member, None)
        if member.startswith("_") or not inspect.isfunction(original):
            continue
        asked = list(inspect.signature(original).parameters.values())
        taken = list(inspect.signature(function).parameters.values())
        limits = [each for each in taken if each.name == "timeout_s"]
        rest = [each for each in taken if each.name not in {each.name for each in asked}]
        assert rest in ([], limits), member
        for wanted, given in zip(asked, [each for each in taken if each not in rest], strict=True):
            assert (given.name, given.kind, given.default) == (
                wanted.name, wanted.kind, wanted.default,
            ), member  # fmt: skip


def test_an_attribute_without_a_type_is_refused(generator: ModuleType) -> None:
    source = 'def __init__(self):\n    self.name = route.name\n    "The topic."\n'
    constructor = ast.parse(source).body[0]
    with pytest.raises(SystemExit, match="the attribute name needs a type"):
        list(generator._attributes(constructor))
