"""Actions on Zenoh: five keys below ``<name>/_action``, named as in ROS 2, and their messages.

===============  ======================================  =========================================
===============  ======================================  =========================================
key              query, or put                           reply
`send_goal`      ``{goal_id, goal}``                     ``{accepted, failure, text}``
`cancel_goal`    ``{goal_id}``                           ``{accepted, text}``
`get_result`     ``{goal_id}``                           ``{status, result, text}``, at the end
`feedback`       put: ``{goal_id, feedback}``            –
`status`         put: ``{goal_id, status}``              –
===============  ======================================  =========================================

Everything is a map: in CBOR, or in JSON if the stream has that encoding and all three types are
known. The client chooses the `goal_id`: 16 bytes, in JSON 32 hexadecimal digits. Sending a goal
twice under one id makes one goal. The words of `status` are those of `GoalStatus` in lower case,
and before the end ``executing`` and ``canceling``.

Nodes of ROS 2 have another form of the same messages (`zacoustic.zenoh.gateway.dialect.ros`).
"""

import enum
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Final

import msgspec

from zacoustic.core.engine.events import GoalFailure, GoalStatus
from zacoustic.core.values.encoding import (
    CBOR,
    TYPED_ENCODINGS,
    decode_application,
    encode_application,
)
from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import PayloadInvalidError
from zacoustic.zenoh.session.marker import is_marked

GOAL_ID_BYTES: Final = 16
"""Size of the id of a goal."""


class ActionKey(enum.StrEnum):
    """The last chunk of the keys of an action."""

    SEND_GOAL = "send_goal"
    CANCEL_GOAL = "cancel_goal"
    GET_RESULT = "get_result"
    FEEDBACK = "feedback"
    STATUS = "status"

    def of(self, name: str) -> str:
        """Return the key of an action."""
        return f"{name}/_action/{self.value}"


_PARTS: Final = {ActionKey.SEND_GOAL: "goal", ActionKey.FEEDBACK: "feedback"}


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to a goal, or to a request to cancel it."""

    accepted: bool
    """Whether it is accepted."""
    failure: GoalFailure | None = None
    """Why a goal is not accepted."""
    text: str = ""
    """The reason as one line."""


class Ending(msgspec.Struct, frozen=True, kw_only=True):
    """How a goal ended."""

    status: GoalStatus
    """Its status."""
    result: Any = None
    """The result, a dict or bytes; None: there is none."""
    text: str = ""
    """One line of text."""


class GoalState(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a goal."""

    goal_id: bytes
    """Its id, 16 bytes."""
    status: str
    """A word of `status`."""
    accepted_unix_ns: int
    """When it was accepted, ns since 1970."""


class ActionForm(ABC):
    """The local form of the messages about one action's goals."""

    encoding: str
    """Zenoh encoding of all messages."""

    @abstractmethod
    def key(self, which: ActionKey) -> str:
        """Return a key of the action."""

    @abstractmethod
    def served(self) -> tuple[str, ...]:
        """Return the key expressions of the action's server."""

    @abstractmethod
    def write_asked(self, which: ActionKey, goal_id: bytes, value: object = None) -> bytes:
        """Write a query or feedback.

        Args:
            which: `SEND_GOAL` with the goal, `FEEDBACK` with the feedback, or another query.
            goal_id: Id of the goal.
            value: The goal or the feedback.

        Raises:
            PayloadInvalidError: The encoding cannot carry the value.
        """

    @abstractmethod
    def read_asked(self, which: ActionKey, payload: bytes, encoding: str) -> "Asked":
        """Read a query or feedback.

        Raises:
            PayloadInvalidError: It is invalid.
        """

    @abstractmethod
    def write_status(self, changed: GoalState, states: Sequence[GoalState]) -> bytes:
        """Write the states of goals.

        Args:
            changed: The goal whose state has changed.
            states: All known goals, including that one.
        """

    @abstractmethod
    def write_verdict(self, which: ActionKey, goal_ids: Sequence[bytes], verdict: Verdict) -> bytes:
        """Write the answer to `SEND_GOAL` or `CANCEL_GOAL` about one goal, or about several."""

    @abstractmethod
    def read_verdict(self, which: ActionKey, payload: bytes, encoding: str) -> Verdict:
        """Read the answer to `SEND_GOAL` or `CANCEL_GOAL`.

        Raises:
            PayloadInvalidError: It is invalid.
        """

    @abstractmethod
    def write_ending(self, ending: Ending) -> bytes:
        """Write the answer to `GET_RESULT`.

        Raises:
            PayloadInvalidError: The encoding cannot carry the result.
        """

    @abstractmethod
    def read_ending(self, payload: bytes, encoding: str) -> Ending:
        """Read the answer to `GET_RESULT`.

        Raises:
            PayloadInvalidError: It is invalid.
        """

    def write_refusal(self, which: ActionKey) -> bytes | None:
        """Write the answer to an unanswerable query; None: send an error reply."""
        return None

    def question_mark(self, which: ActionKey, mark: bytes | None) -> bytes | None:
        """Return the attachment of a query; `mark` is a gateway's mark of its origin."""
        return mark

    def answer_mark(self, asked: bytes | None, mark: bytes | None) -> bytes | None:
        """Return the attachment of the answer to a query with the attachment `asked`."""
        return mark

    def is_marked(self, attachment: bytes) -> bool:
        """Return whether a message with this attachment came from the channel."""
        return is_marked(attachment)


class ActionMessages(ActionForm):
    """Maps, in CBOR or JSON.

    Args:
        name: The action.
        goal: Type of a goal; None: opaque bytes.
        feedback: Type of feedback; None: opaque bytes.
        result: Type of a result; None: opaque bytes.
        encoding: The stream's Zenoh encoding.
    """

    def __init__(
        self,
        name: str,
        goal: TypeSpec | None,
        feedback: TypeSpec | None,
        result: TypeSpec | None,
        encoding: str,
    ) -> None:
        is_typed = None not in (goal, feedback, result)
        fits = encoding.split(";", 1)[0] in TYPED_ENCODINGS
        self.encoding = encoding if is_typed and fits else CBOR
        self._name = name
        self._types = {"goal": goal, "feedback": feedback, "result": result}

    def key(self, which: ActionKey) -> str:
        """Return a key of the action."""
        return which.of(self._name)

    def served(self) -> tuple[str, ...]:
        """Return the key expression of all keys of the action."""
        return (f"{self._name}/_action/*",)

    # Goals, and queries about them

    def write_asked(self, which: ActionKey, goal_id: bytes, value: object = None) -> bytes:
        """Write a query or feedback: the goal's id, and the goal or the feedback."""
        part = _PARTS.get(which)
        return self._write(goal_id, {} if part is None else {part: value})

    def write_status(self, changed: GoalState, states: Sequence[GoalState]) -> bytes:
        """Write the state of the changed goal."""
        return self._write(changed.goal_id, {"status": changed.status})

    def read_asked(self, which: ActionKey, payload: bytes, encoding: str) -> "Asked":
        """Read a query or feedback."""
        said = self._read(payload, encoding)
        goal_id = said.get("goal_id")
        if isinstance(goal_id, str):
            try:
                goal_id = bytes.fromhex(goal_id.replace("-", ""))
            except ValueError:
                goal_id = None
        if not isinstance(goal_id, bytes) or len(goal_id) != GOAL_ID_BYTES:
            raise PayloadInvalidError(
                f"goal_id is {said.get('goal_id')!r}; allowed: {GOAL_ID_BYTES} bytes, or "
                f"{2 * GOAL_ID_BYTES} hexadecimal digits"
            )
        part = _PARTS.get(which)
        value = None if part is None else self._value(said, part, encoding)
        return Asked(goal_id=goal_id, value=value)

    # Answers

    def write_verdict(self, which: ActionKey, goal_ids: Sequence[bytes], verdict: Verdict) -> bytes:
        """Write the answer to `SEND_GOAL` or `CANCEL_GOAL`."""
        failure = verdict.failure.name if verdict.failure is not None else None
        said = {"accepted": verdict.accepted, "failure": failure, "text": verdict.text}
        return encode_application(said, self.encoding)

    def read_verdict(self, which: ActionKey, payload: bytes, encoding: str) -> Verdict:
        """Read the answer to `SEND_GOAL` or `CANCEL_GOAL`."""
        said = self._read(payload, encoding)
        accepted, text, failure = said.get("accepted"), said.get("text") or "", said.get("failure")
        if not isinstance(accepted, bool) or not isinstance(text, str):
            raise PayloadInvalidError("accepted is missing; allowed: true, false")
        known = GoalFailure.__members__.get(failure) if isinstance(failure, str) else None
        if not accepted:
            known = known or GoalFailure.REJECTED
        return Verdict(accepted=accepted, failure=known if not accepted else None, text=text)

    def write_ending(self, ending: Ending) -> bytes:
        """Write the answer to `GET_RESULT`."""
        status = ending.status.name.lower()
        said = {"status": status, "result": ending.result, "text": ending.text}
        return encode_application(said, self.encoding)

    def read_ending(self, payload: bytes, encoding: str) -> Ending:
        """Read the answer to `GET_RESULT`."""
        said = self._read(payload, encoding)
        name, text = said.get("status"), said.get("text") or ""
        status = GoalStatus.__members__.get(name.upper()) if isinstance(name, str) else None
        if status is None or not isinstance(text, str):
            allowed = ", ".join(each.name.lower() for each in GoalStatus)
            raise PayloadInvalidError(f"status is {name!r}; allowed: {allowed}")
        result = None if said.get("result") is None else self._value(said, "result", encoding)
        return Ending(status=status, result=result, text=text)

    # Below the methods above

    def _write(self, goal_id: bytes, said: dict[str, object]) -> bytes:
        is_cbor = self.encoding.startswith(CBOR)
        return encode_application(
            {"goal_id": goal_id if is_cbor else goal_id.hex(), **said}, self.encoding
        )

    def _read(self, payload: bytes, encoding: str) -> dict[str, Any]:
        said = decode_application(payload, self._said(encoding))
        if not isinstance(said, dict):
            raise PayloadInvalidError(f"{type(said).__name__}; allowed: a map")
        return said

    def _said(self, encoding: str) -> str:
        kind = encoding.split(";", 1)[0]
        return encoding if kind in TYPED_ENCODINGS else self.encoding

    def _value(self, said: dict[str, Any], part: str, encoding: str) -> object:
        """Return a value; base64 texts in JSON become bytes."""
        value, spec = said.get(part), self._types[part]
        if spec is None:
            if not isinstance(value, bytes):
                raise PayloadInvalidError(f"{part} is {value!r}; allowed: bytes")
            return value
        if value is None:
            raise PayloadInvalidError(f"{part} is missing; allowed: a value of {spec.name}")
        said_encoding = self._said(encoding)
        again = encode_application(value, said_encoding)
        return spec.validate(decode_application(again, said_encoding, type_spec=spec))


class Asked(msgspec.Struct, frozen=True, kw_only=True):
    """A query about a goal, feedback or a status, after reading."""

    goal_id: bytes
    """Id of the goal, 16 bytes."""
    value: Any
    """The goal or the feedback, a dict or bytes; None: there is none."""
    is_about_all: bool = False
    """It concerns all goals, whatever `goal_id`: only a cancel of ROS can."""
    accepted_until_ns: int | None = None
    """With `is_about_all`: only those accepted until then, ns since 1970."""
