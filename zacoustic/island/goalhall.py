"""Where the goals of an island arrive: queries about goals, and what is to be said of each.

Behind it stands whoever pursues them: a program, or a gateway with the water behind it. A goal is
begun once, however often it is sent; whoever asks for its result waits for the end, or is answered
from what was kept.
"""

from collections.abc import Callable
from typing import Final, Protocol

from zacoustic.core.actions.news import GoalStatus
from zacoustic.core.clock import Clock, seconds_to_ns
from zacoustic.core.events import CallFailure
from zacoustic.errors import PayloadInvalidError, ZacousticError
from zacoustic.island.goals import ActionKey, ActionMessages, Ending, Verdict
from zacoustic.island.queries import Answer, HeldQuery

GOALS_LIMIT: Final = 256
"""Goals of one action that are known at once; of those that have ended the oldest makes room."""


class Pursuer(Protocol):
    """Who pursues the goals of a hall."""

    def begin(self, goal_id: bytes, value: object, held: HeldQuery) -> None:
        """Begin a goal; `answer` or `fail` follows.

        Args:
            goal_id: Its name.
            value: The goal, as its type says.
            held: The query that brought it.

        Raises:
            ZacousticError: It cannot be begun.
        """
        ...

    def cancel(self, goal_id: bytes) -> None:
        """End a goal; `answer_cancel`, `end` or `fail` follows."""
        ...


Put = Callable[[str, bytes, str], None]
"""``(key, payload, encoding)``: puts feedback and status on the island."""


class _Known:
    """A goal."""

    def __init__(self) -> None:
        self.verdict: Verdict | None = None
        self.ending: Ending | None = None
        self.failure: tuple[CallFailure, str] | None = None
        self.over_at: int | None = None
        self.waiting: dict[ActionKey, list[HeldQuery]] = {
            key: [] for key in (ActionKey.SEND_GOAL, ActionKey.CANCEL_GOAL, ActionKey.GET_RESULT)
        }


class GoalHall:
    """The goals of one action on one island; for the loop.

    Args:
        name: The action.
        messages: Reads and writes what is said.
        pursuer: Pursues the goals.
        put: Puts feedback and status.
        keep_s: How long the end of a goal is kept, s.
        clock: Where instants come from.
        attachment: Goes with each answer.
    """

    def __init__(
        self,
        name: str,
        messages: ActionMessages,
        pursuer: Pursuer,
        *,
        put: Put,
        keep_s: float,
        clock: Clock,
        attachment: bytes | None = None,
    ) -> None:
        self._name = name
        self._messages = messages
        self._pursuer = pursuer
        self._put = put
        self._keep_ns = seconds_to_ns(keep_s)
        self._clock = clock
        self._attachment = attachment
        self._goals: dict[bytes, _Known] = {}
        self._keys = {key.of(name): key for key in ActionKey}

    # From the island

    def take(self, held: HeldQuery) -> None:
        """Take a query."""
        key = self._keys.get(str(held.query.key_expr))
        if key is None:
            text = f"a wildcard sends no goal, only {ActionKey.SEND_GOAL.of(self._name)} does"
            held.refuse(CallFailure.BAD_REQUEST, text)
            return
        if key in (ActionKey.FEEDBACK, ActionKey.STATUS):
            held.answer([])
            return
        query = held.query
        payload = query.payload.to_bytes() if query.payload is not None else b""
        part = "goal" if key is ActionKey.SEND_GOAL else None
        try:
            asked = self._messages.read_asked(payload, str(query.encoding), part=part)
        except PayloadInvalidError as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))
            return
        if key is ActionKey.SEND_GOAL:
            self._send(asked.goal_id, asked.value, held)
            return
        goal = self._goals.get(asked.goal_id)
        if goal is None:
            held.refuse(CallFailure.BAD_REQUEST, f"no goal {asked.goal_id.hex()} is known")
            return
        goal.waiting[key].append(held)
        if key is ActionKey.CANCEL_GOAL and goal.over_at is None:
            if len(goal.waiting[key]) == 1:
                self._pursuer.cancel(asked.goal_id)
        else:
            self._say(goal)

    # From who pursues them

    def adopt(self, goal_id: bytes) -> None:
        """Know a goal that was begun in a former life."""
        self._goals[goal_id] = _Known()

    def answer(self, goal_id: bytes, verdict: Verdict) -> None:
        """A goal is accepted, or refused: then it is over."""
        goal = self._goals.get(goal_id)
        if goal is None or goal.verdict is not None or goal.over_at is not None:
            return
        goal.verdict = verdict
        if verdict.accepted:
            self._put_status(goal_id, "executing")
        else:
            text = verdict.text or "the goal was rejected"
            self._is_over(goal, (CallFailure.BAD_REQUEST, text))
        self._say(goal)

    def answer_cancel(self, goal_id: bytes, verdict: Verdict) -> None:
        """A goal will end, or will not."""
        goal = self._goals.get(goal_id)
        if goal is None:
            return
        if verdict.accepted:
            self._put_status(goal_id, "canceling")
        self._tell(goal, ActionKey.CANCEL_GOAL, self._messages.write_verdict(verdict))

    def feed(self, goal_id: bytes, value: object) -> None:
        """Put feedback.

        Raises:
            PayloadInvalidError: The encoding cannot carry it.
        """
        payload = self._messages.write_asked(goal_id, feedback=value)
        self._put(ActionKey.FEEDBACK.of(self._name), payload, self._messages.encoding)

    def end(self, goal_id: bytes, ending: Ending) -> None:
        """A goal has ended.

        Raises:
            PayloadInvalidError: The encoding cannot carry the result.
        """
        goal = self._goals.get(goal_id)
        if goal is None or goal.over_at is not None:
            return
        self._messages.write_ending(ending)
        goal.verdict = goal.verdict or Verdict(accepted=True)
        goal.ending = ending
        self._is_over(goal, None)
        self._put_status(goal_id, ending.status.name.lower())
        self._say(goal)

    def fail(self, goal_id: bytes, failure: CallFailure, text: str) -> None:
        """Nothing more will be heard of a goal."""
        goal = self._goals.get(goal_id)
        if goal is not None and goal.over_at is None:
            self._is_over(goal, (failure, text))
            self._say(goal)

    # Below the methods above

    def _send(self, goal_id: bytes, value: object, held: HeldQuery) -> None:
        goal = self._goals.get(goal_id)
        if goal is not None:
            goal.waiting[ActionKey.SEND_GOAL].append(held)
            self._say(goal)
            return
        self._make_room()
        if len(self._goals) >= GOALS_LIMIT:
            held.refuse(CallFailure.NO_SERVER, f"{GOALS_LIMIT} goals are under way already")
            return
        goal = self._goals[goal_id] = _Known()
        goal.waiting[ActionKey.SEND_GOAL].append(held)
        try:
            self._pursuer.begin(goal_id, value, held)
        except ZacousticError as error:
            del self._goals[goal_id]
            is_wrong = isinstance(error, PayloadInvalidError)
            held.refuse(CallFailure.BAD_REQUEST if is_wrong else CallFailure.NO_SERVER, str(error))

    def _make_room(self) -> None:
        """Forget goals that ended long ago; and, where room is short, the oldest of the others."""
        now = self._clock()
        over = [
            (goal.over_at, goal_id)
            for goal_id, goal in self._goals.items()
            if goal.over_at is not None
        ]
        too_many = len(self._goals) - GOALS_LIMIT + 1
        for number, (over_at, goal_id) in enumerate(sorted(over)):
            if number < too_many or over_at + self._keep_ns <= now:
                del self._goals[goal_id]

    def _is_over(self, goal: _Known, failure: tuple[CallFailure, str] | None) -> None:
        goal.over_at = self._clock()
        goal.failure = failure

    def _say(self, goal: _Known) -> None:
        """Answer those who wait for what is known now."""
        if goal.verdict is not None:
            self._tell(goal, ActionKey.SEND_GOAL, self._messages.write_verdict(goal.verdict))
        if goal.ending is not None:
            self._tell(goal, ActionKey.GET_RESULT, self._messages.write_ending(goal.ending))
        if goal.over_at is None:
            return
        is_canceled = goal.ending is not None and goal.ending.status is GoalStatus.CANCELED
        text = "" if is_canceled else "the goal is over"
        over = Verdict(accepted=is_canceled, text=text)
        self._tell(goal, ActionKey.CANCEL_GOAL, self._messages.write_verdict(over))
        if goal.failure is not None:
            for key in (ActionKey.SEND_GOAL, ActionKey.GET_RESULT):
                waiting, goal.waiting[key] = goal.waiting[key], []
                for held in waiting:
                    held.refuse(*goal.failure)

    def _tell(self, goal: _Known, key: ActionKey, payload: bytes) -> None:
        waiting, goal.waiting[key] = goal.waiting[key], []
        answer = Answer(
            key=key.of(self._name),
            payload=payload,
            encoding=self._messages.encoding,
            attachment=self._attachment,
        )
        for held in waiting:
            held.answer([answer])

    def _put_status(self, goal_id: bytes, status: str) -> None:
        payload = self._messages.write_asked(goal_id, status=status)
        self._put(ActionKey.STATUS.of(self._name), payload, self._messages.encoding)
