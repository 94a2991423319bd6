"""Routes of endpoints: to a stream, or on Zenoh to a key that no configuration maps."""

from typing import Any, Final, Generic, TypeVar

import msgspec

from zacoustic.core.base.qos import Qos
from zacoustic.core.streams.keys import Instance, fault_of_name
from zacoustic.core.streams.table import Stream
from zacoustic.core.values.encoding import CBOR, OPAQUE
from zacoustic.errors import ConfigError
from zacoustic.zenoh.node.form import Form, free_form

FREE_TIMEOUT_S: Final = 60.0
"""Time limit of a call that no stream describes, s: a stream's default."""

FREE_RESULT_TIMEOUT_S: Final = 3600.0
"""How long the result of a goal that no stream describes is kept, s: a stream's default."""

T = TypeVar("T")
Request = TypeVar("Request")
Response = TypeVar("Response")
Goal = TypeVar("Goal")
Feedback = TypeVar("Feedback")
Result = TypeVar("Result")


class Route(msgspec.Struct, frozen=True, kw_only=True):
    """The route of one endpoint."""

    name: str
    """The topic as the application names it; for a service or an action its key."""
    stream: Stream | None
    """The stream; None: a Zenoh key that no configuration maps."""

    @property
    def known_stream(self) -> Stream:
        """The stream, on a link, where every route has one."""
        assert self.stream is not None, f"{self.name} is no stream"
        return self.stream


class TopicRoute(Route, Generic[T], frozen=True, kw_only=True):
    """The route of the samples of one endpoint."""

    key: str | None
    """The only key; None: every key of the name."""
    expression: str
    """Zenoh key expression that covers the keys."""
    instance: Instance = ()
    """Value numbers of `key`; see `zacoustic.core.streams.keys`."""
    form: Form[T]
    """The Python side of the values."""
    encoding: str
    """Encoding on Zenoh."""
    qos: Qos
    """How samples wait."""


class ServiceRoute(Route, Generic[Request, Response], frozen=True, kw_only=True):
    """The route of the calls of one endpoint."""

    request: Form[Request]
    """The Python side of requests."""
    response: Form[Response]
    """The Python side of responses."""
    encoding: str
    """Encoding on Zenoh."""
    timeout_s: float
    """Time after which a caller without an answer gives up, s."""
    qos: Qos
    """Priority and linger."""


class ActionRoute(Route, Generic[Goal, Feedback, Result], frozen=True, kw_only=True):
    """The route of the goals of one endpoint."""

    goal: Form[Goal]
    """The Python side of goals."""
    feedback: Form[Feedback]
    """The Python side of feedback."""
    result: Form[Result]
    """The Python side of results."""
    encoding: str
    """Encoding on Zenoh."""
    timeout_s: float
    """Time after which a client without an answer to its goal gives up, s."""
    result_timeout_s: float
    """How long a result is kept, s."""
    qos: Qos
    """Priority and linger."""


def free_topic(sample_type: object, name: str, qos: Qos, *, wildcards: bool) -> TopicRoute[Any]:
    """Return the route of a key that no configuration maps.

    Raises:
        ConfigError: The name is not a key expression, or has wildcards that are not allowed.
    """
    _check_name(name, wildcards=wildcards)
    form = free_form(sample_type, where=name)
    return TopicRoute(
        name=name,
        key=None if "*" in name or "$" in name else name,
        expression=name,
        stream=None,
        form=form,
        encoding=OPAQUE if form.spec is None else CBOR,
        qos=qos,
    )


def free_service(types: tuple[object, object], name: str, qos: Qos) -> ServiceRoute[Any, Any]:
    """Return the route of a service that no configuration maps; `types`: request, response.

    Raises:
        ConfigError: The name is not a key.
    """
    _check_name(name, wildcards=False)
    request = free_form(types[0], where=f"{name}: request")
    response = free_form(types[1], where=f"{name}: response")
    is_typed = request.spec is not None or response.spec is not None
    return ServiceRoute(
        name=name,
        stream=None,
        request=request,
        response=response,
        encoding=CBOR if is_typed else OPAQUE,
        timeout_s=FREE_TIMEOUT_S,
        qos=qos,
    )


def free_action(
    types: tuple[object, object, object], name: str, qos: Qos
) -> ActionRoute[Any, Any, Any]:
    """Return the route of an action that no configuration maps; types: goal, feedback, result.

    Raises:
        ConfigError: The name is not a key.
    """
    _check_name(name, wildcards=False)
    parts = ("goal", "feedback", "result")
    goal, feedback, result = (
        free_form(each, where=f"{name}: {part}") for each, part in zip(types, parts, strict=True)
    )
    is_typed = any(form.spec is not None for form in (goal, feedback, result))
    return ActionRoute(
        name=name,
        stream=None,
        goal=goal,
        feedback=feedback,
        result=result,
        encoding=CBOR if is_typed else OPAQUE,
        timeout_s=FREE_TIMEOUT_S,
        result_timeout_s=FREE_RESULT_TIMEOUT_S,
        qos=qos,
    )


def _check_name(name: str, *, wildcards: bool) -> None:
    if "{" in name:
        raise ConfigError(f'name: "{name}" has placeholders', hint="they need config=FILE")
    wrong = fault_of_name(name)
    if wrong and not (wildcards and any(mark in name for mark in "*$@")):
        raise ConfigError(f'name: "{name}" {wrong}')
