"""`Outstanding`: what an application awaits from an engine, reported if that engine is lost.

A new engine replaces one that has raised, and continues from the journal, as after a crash. But the
application has not crashed and still awaits its requests. So the driver of the engine stores the
ids of all pending requests outside of it:

- A journalled sample continues. Any other one ends with a `DeliveryEnded`.
- A journalled goal continues, without a `GoalRecovered`, since it is known here. Any other goal,
  and each call and range, fails. Whether it was executed is unknown.
- Subscriptions to on-demand topics and periodic range measurements are requested again.
- Outcomes that the old engine had reported and the new one finds in the journal are not repeated.
"""

from collections.abc import Iterator
from typing import Any, Final

from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
    Event,
    GoalFailure,
    GoalKey,
    ResponseReceived,
)
from zacoustic.core.engine.tap import EngineCall, Tap, call_engine
from zacoustic.core.peers.ranging import RangeFailed, RangeFailure, RangeMeasured
from zacoustic.core.streams.commands import COMMANDS_STREAM_ID
from zacoustic.core.streams.keydelivery import KEYS_STREAM_ID
from zacoustic.core.streams.routing import ROUTING_STREAM_ID
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.status import STATUS_STREAM_ID
from zacoustic.core.transport.actions.events import (
    CancelAnswered,
    FeedbackReceived,
    GoalAnswered,
    GoalFailed,
    GoalRecovered,
    ResultReceived,
)

MOST_ENDED: Final = 1024
"""Reported outcomes of samples and of goals to remember, since the journal may still have them."""
_ASKED: Final = {
    "commands.send": COMMANDS_STREAM_ID,
    "status.ask": STATUS_STREAM_ID,
    "keys.send": KEYS_STREAM_ID,
    "routing.send": ROUTING_STREAM_ID,
}
"""The services that every node serves, by the command that calls them."""
_CALLS: Final = (
    "publish", "call", "cancel", *_ASKED, "actions.send_goal",
    "ranging.request", "ranging.cancel", "ranging.repeat", "subscriptions.want",
)  # fmt: skip
_TEXT: Final = "an internal error has ended the engine of this node"
_UNKNOWN_TEXT: Final = f"{_TEXT}: whether it was executed is unknown"


class Outstanding:
    """The pending requests to the engines of one node."""

    def __init__(self) -> None:
        self._samples: dict[int, tuple[int, bool]] = {}
        self._calls: dict[int, int] = {}
        self._goals: dict[GoalKey, bool] = {}
        self._ranges: dict[int, int] = {}
        self._subscriptions: dict[int, dict[str, Any]] = {}
        self._schedules: dict[int, dict[str, Any]] = {}
        self._ended_samples: dict[int, None] = {}
        self._ended_goals: dict[GoalKey, None] = {}

    def watch(self, engine: Engine) -> None:
        """Note all requests to an engine from now on."""
        Tap(engine, self._note, _CALLS)

    def passes(self, event: Event) -> bool:
        """Note an event; False: it was reported before."""
        match event:
            case DeliveryStored():
                if event.delivery_id in self._samples:
                    self._samples[event.delivery_id] = event.stream_id, True
            case DeliveryEnded():
                self._samples.pop(event.delivery_id, None)
                return _is_first(self._ended_samples, event.delivery_id)
            case ResponseReceived() | CallFailed():
                self._calls.pop(event.call_id, None)
            case RangeMeasured() | RangeFailed():
                if event.range_id is not None:
                    self._ranges.pop(event.range_id, None)
            case GoalRecovered():
                is_known = event.goal in self._goals or event.goal in self._ended_goals
                if not is_known:
                    self._goals[event.goal] = True
                return not is_known
            case GoalAnswered(accepted=True):
                if event.goal in self._goals:
                    self._goals[event.goal] = True
                return event.goal not in self._ended_goals
            case FeedbackReceived() | CancelAnswered():
                return event.goal not in self._ended_goals
            case GoalAnswered() | ResultReceived() | GoalFailed():
                self._goals.pop(event.goal, None)
                return _is_first(self._ended_goals, event.goal)
            case _:
                pass
        return True

    def renew(self, engine: Engine, now: int) -> list[Event]:
        """Continue with a new engine, which is watched from now on.

        Args:
            engine: The new engine, made from the journal, not yet polled.
            now: The instant, ns.

        Returns:
            Events for the application, in order; those that `passes` lets through.
        """
        events: list[Event] = []
        while (event := engine.poll_event()) is not None:
            events.append(event)
        recovered = {event.goal for event in events if isinstance(event, GoalRecovered)}
        lost = [*self._lost(engine, recovered, now)]
        for name, kept in (
            ("subscriptions.want", self._subscriptions),
            ("ranging.repeat", self._schedules),
        ):
            for arguments in kept.values():
                call_engine(engine, name, arguments | {"now": now})
        self.watch(engine)
        return lost + events

    def _lost(self, engine: Engine, recovered: set[GoalKey], now: int) -> Iterator[Event]:
        """Report the end of each request that the new engine does not know."""
        for delivery_id, (stream_id, is_stored) in self._samples.items():
            # A journalled one may have ended, and the engine was lost before reporting it.
            if not is_stored or not engine.is_delivering(delivery_id):
                yield DeliveryEnded(
                    delivery_id=delivery_id,
                    stream_id=stream_id,
                    outcome=DeliveryOutcome.CANCELLED,
                    missing=_receivers(engine, stream_id),
                    ended_at=now,
                    detail=f"{_TEXT}: whether it has arrived is unknown",
                )
        for call_id, stream_id in self._calls.items():
            yield CallFailed(
                call_id=call_id,
                stream_id=stream_id,
                failure=CallFailure.UNKNOWN,
                text=_UNKNOWN_TEXT,
            )
        for goal, is_accepted in self._goals.items():
            if goal in recovered:
                continue
            if is_accepted:
                yield GoalFailed(goal=goal, failure=GoalFailure.UNKNOWN, text=_UNKNOWN_TEXT)
            else:
                yield GoalAnswered(
                    goal=goal, accepted=False, failure=GoalFailure.UNKNOWN, text=_UNKNOWN_TEXT
                )
        for range_id, address in self._ranges.items():
            yield RangeFailed(
                range_id=range_id, address=address, failure=RangeFailure.TIMED_OUT, text=_TEXT
            )

    def _note(self, call: EngineCall) -> None:
        """Note a command."""
        if call.error is not None:
            return
        arguments, result = call.arguments, call.result
        match call.name:
            case "publish" if result:
                self._samples[result] = arguments["stream_id"], False
                self._ended_samples.pop(result, None)
            case "call":
                self._calls[result] = arguments["stream_id"]
            case name if name in _ASKED:
                self._calls[result] = _ASKED[name]
            case "cancel":
                self._calls.pop(arguments["call_id"], None)
            case "actions.send_goal":
                self._goals[result] = False
                self._ended_goals.pop(result, None)
            case "ranging.request":
                self._ranges[result] = arguments["address"]
            case "ranging.cancel":
                self._ranges.pop(arguments["range_id"], None)
            case "ranging.repeat":
                self._schedules[arguments["address"]] = arguments
            case "subscriptions.want":
                self._subscriptions[arguments["stream_id"]] = arguments
            case _:
                pass


def _is_first(ended: dict[Any, None], name: object) -> bool:
    """Remember an outcome; False: it is remembered already."""
    if name in ended:
        return False
    ended[name] = None
    while len(ended) > MOST_ENDED:
        del ended[next(iter(ended))]
    return True


def _receivers(engine: Engine, stream_id: int) -> tuple[int, ...]:
    """Return the receivers that may lack a sample."""
    spec = engine.table.by_id(stream_id).spec
    listed = spec.subscribers if isinstance(spec, TopicSpec) else None
    return tuple(sorted(set(engine.table.nodes if listed is None else listed) - {engine.address}))
