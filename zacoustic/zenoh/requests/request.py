"""One request to a gateway, as a row that both ends read.

A request is a `get` on ``@acoustic/ADDRESS/SUBJECT?NAME=VALUE;…``. A local gateway answers for its
own node. For a remote node the local gateway with the lowest address asks; requests about unknown
nodes are left to other gateways. A wildcard in place of the address means each local gateway, for
its own node: browsing never asks a remote node.

A file of this package has all of one request: parameters, answer, engine call, text. The list of
`zacoustic.zenoh.requests.table` makes gateways declare it.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final, Generic, NamedTuple, TypeVar

import msgspec

from zacoustic.text.digits import real_number, whole_number
from zacoustic.zenoh.requests.context import Asking

if TYPE_CHECKING:
    from zacoustic.core.engine.engine import Engine

Q = TypeVar("Q")
A = TypeVar("A", bound=msgspec.Struct)

PREFIX: Final = "@acoustic"
"""First chunk of all keys of gateways and their nodes."""
ANY_NODE: Final = "*"
"""Chunk in place of an address: each local gateway, for its own node."""
_NUMBER: Final = "[0-9]{1,20}"
_FIELD: Final = re.compile(r"\{(\w+)\}")


class Parameter(NamedTuple):
    """One parameter of a request."""

    read: Callable[[str], Any]
    """Reads its text; None: the value is not allowed."""
    allowed: str
    """The allowed values, for errors."""
    is_required: bool = False
    """Whether it must be there."""


def one_of(words: Mapping[str, Any], *, is_required: bool = False) -> Parameter:
    """Return a parameter with these words, and what each of them means."""
    return Parameter(words.get, ", ".join(words), is_required)


def seconds(most_s: float, allowed: str) -> Parameter:
    """Return a parameter that is a time above 0 and at most `most_s`, s."""

    def read(text: str) -> float | None:
        value = real_number(text)
        return value if value is not None and 0 < value <= most_s and value < math.inf else None

    return Parameter(read, allowed)


FLAG: Final = one_of({"true": True, "false": False})
NUMBER: Final = Parameter(lambda text: whole_number(text.strip()), "whole numbers")


class Request(msgspec.Struct, Generic[Q, A], frozen=True, kw_only=True):
    """One row: how a request is asked, executed and answered."""

    subject: str
    """End of its key; a name in braces stands for a number, which is a field of the question."""
    parameters: Mapping[str, Parameter]
    """Its parameters by name, without `within_s`."""
    make: Callable[..., Q]
    """Makes the question from numbers of the key and parameters; raises `ValueError` naming a
    value and the allowed ones."""
    tell: Callable[[Q], Mapping[str, object]] = msgspec.to_builtins
    """Returns the same of a question: numbers of the key and parameters; None is left out."""
    answer: type[A]
    """Type of the answer, sent as JSON."""
    begin: "Callable[[Asking[Q, A], Engine, int], None]"
    """Calls the engine, now; the answer may come later. Raises `LocalError` or `ValueError`."""
    within_s: float = 0.0
    """Default time limit of an answer, s."""
    most_s: float = 0.0
    """Longest time limit, s; 0: an answer comes at once, and there is no such parameter."""
    is_own: bool = False
    """Whether a gateway takes it for its own node only."""
    not_here: str = ""
    """For remote nodes only: what an error says to one who asks for a local node."""

    @property
    def expression(self) -> str:
        """Key expression of the request to all nodes."""
        return f"{PREFIX}/{ANY_NODE}/{_FIELD.sub('*', self.subject)}"

    def selector(self, node: int | None, question: Q, within_s: float | None) -> tuple[str, str]:
        """Return key expression and parameters of a query.

        Args:
            node: Address; None: the nodes of all local gateways.
            question: The question.
            within_s: Time limit of the answer, s; None: the default.
        """
        told = {**self.tell(question), "within_s": within_s if self.most_s else None}
        subject = _FIELD.sub(lambda name: str(told.pop(name[1])), self.subject)
        words = [f"{name}={_text(value)}" for name, value in told.items() if value is not None]
        return f"{PREFIX}/{ANY_NODE if node is None else node}/{subject}", ";".join(words)

    def decode(self, payload: bytes) -> A:
        """Read an answer."""
        return msgspec.json.decode(payload, type=self.answer)

    def target(
        self, key: str, parameters: Iterable[str]
    ) -> tuple[int | None, dict[str, int]] | None:
        """Read the target of a query: the node, None for all local ones; and numbers in the key.

        Returns:
            Both; or None: the query browses.
        """
        subject = _FIELD.sub(rf"(?P<\1>{_NUMBER})", self.subject)
        found = re.fullmatch(rf"{PREFIX}/(?:({_NUMBER})|\*)/{subject}", key)
        if found is None:
            return None
        required = {name for name, each in self.parameters.items() if each.is_required}
        if found[1] is None and (self.not_here or not required <= set(parameters)):
            return None
        numbers = {name: int(text) for name, text in found.groupdict().items()}
        return None if found[1] is None else int(found[1]), numbers

    def read(
        self, key: str, numbers: Mapping[str, int], parameters: Mapping[str, str]
    ) -> tuple[Q, float]:
        """Read the question of a query, and its time limit, s.

        Raises:
            ValueError: Names a parameter, its value and the allowed values.
        """
        known = dict(self.parameters)
        if self.most_s:
            allowed = f"seconds above 0, at most {self.most_s:g}"
            known["within_s"] = seconds(self.most_s, allowed)
        values: dict[str, Any] = dict(numbers)
        for name, text in parameters.items():
            if name.startswith("_"):
                continue
            if name not in known:
                raise ValueError(f"{name} is no parameter of {key}; allowed: {', '.join(known)}")
            values[name] = known[name].read(text)
            if values[name] is None:
                raise ValueError(f"{name} is {text}; allowed: {known[name].allowed}")
        for name, each in known.items():
            if each.is_required and name not in values:
                raise ValueError(f"{name} is missing; allowed: {each.allowed}")
        within_s = values.pop("within_s", self.within_s)
        return self.make(**values), within_s


def _text(value: object) -> str:
    """Write the value of a parameter."""
    match value:
        case bool():
            return str(value).lower()
        case float():
            return f"{value:.10g}"
        case tuple() | list():
            return ",".join(map(str, value))
    return str(value)
