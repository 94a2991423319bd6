"""Reactions of recorded programs to requests and goals.

In another run the same requests come at other times, again, or never. So a reaction is stored by
its request: the value, with the delays of the steps that followed.
"""

from typing import Any, Final

import msgspec

from zacoustic.run.recording.calls import Recorded

_REPLIES: Final = ("reply", "reply_error")
_GOALS: Final = (
    "actions.accept", "actions.reject", "actions.publish_feedback", "actions.finish",
    "actions.answer_cancel",
)  # fmt: skip


REACTIONS: Final = frozenset((*_REPLIES, *_GOALS))
"""The calls of an engine that are reactions."""


class Step(msgspec.Struct, frozen=True):
    """One action of a program."""

    after_ns: int
    """Time since the request, ns."""
    name: str
    """The call of the engine."""
    arguments: dict[str, Any]
    """Its arguments, without those that name the request, and the instant."""


class Reactions:
    """Reactions of programs by request."""

    def __init__(self) -> None:
        self._found: dict[tuple[int, int, bytes], list[list[Step]]] = {}
        self._asked: dict[tuple[int, str], tuple[int, list[Step]]] = {}

    def note_question(
        self, node: int, key: object, stream_id: int, value: object, at_ns: int
    ) -> None:
        """Note a received request or goal."""
        steps: list[Step] = []
        self._found.setdefault(_key(node, stream_id, value), []).append(steps)
        self._asked[node, _name(key)] = at_ns, steps

    def note_call(self, node: int, call: Recorded, at_ns: int) -> None:
        """Note a step, if the call is one."""
        word = "call" if call.name in _REPLIES else "goal"
        if call.name not in (*_REPLIES, *_GOALS) or word not in call.arguments:
            return
        asked = self._asked.get((node, _name(call.arguments[word])))
        if asked is not None:
            begun_ns, steps = asked
            said = {
                name: each for name, each in call.arguments.items() if name not in (word, "now")
            }
            steps.append(Step(at_ns - begun_ns, call.name, said))

    def note_answer(
        self, node: int, stream_id: int, value: object, took_ns: int, answer: object
    ) -> None:
        """Note an answer from a program that is not recorded."""
        step = Step(took_ns, "reply", {"value": answer})
        self._found.setdefault(_key(node, stream_id, value), []).append([step])

    def copy(self) -> "Reactions":
        """Return a copy from which steps can be taken."""
        copied = Reactions()
        copied._found = {key: list(steps) for key, steps in self._found.items()}
        return copied

    def of(self, node: int, stream_id: int, value: object) -> list[Step] | None:
        """Return the reaction to a request; the last one repeats for ever. None: unknown."""
        known = self._found.get(_key(node, stream_id, value))
        if not known:
            return None
        return known.pop(0) if len(known) > 1 else known[0]


def _key(node: int, stream_id: int, value: object) -> tuple[int, int, bytes]:
    return node, stream_id, msgspec.msgpack.encode(value, order="deterministic")


def _name(key: Any) -> str:  # noqa: ANN401 (a key, or the parts of one)
    """Return the name of a request, from its parts in an event or from the record of a call."""
    if isinstance(key, msgspec.Struct):
        return str([getattr(key, name) for name in key.__struct_fields__])
    return str(list(key.values()) if isinstance(key, dict) else key)
