"""The audit log: who requested what of a node, or of others through it, and how it ended.

It stands beside the journal as ``node-ADDRESS.audit``, readable only by its owner, with one JSON
object per line::

    {"utc": "2026-01-01T12:00:03.250Z", "node": 2, "by": 1, "what": "call", "about": "auv1/arm",
     "outcome": "answered"}

`by` is the address of the node that sends the command, call or goal. 0 is this node's own network
or program; `to` then names the target node. Without a seal anyone can forge an address, and
``sealed`` is false. Values are not logged here; recordings contain them.

The log observes the engine's calls from outside (`zacoustic.core.engine.tap`), so no driver needs
to know it. At 8 MiB the file is renamed to ``….1`` and replaces the former one of that name.
"""

import logging
from collections import OrderedDict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CancelRequested,
    CommandHandled,
    GoalAnswered,
    GoalFailed,
    GoalReceived,
    KeyDelivered,
    RequestReceived,
    ResponseReceived,
    ResultReceived,
    RoutingHandled,
    SealAlarm,
)
from zacoustic.core.engine.tap import EngineCall, Tap
from zacoustic.core.streams.commands import RemoteCommand
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.goals import GoalKey
from zacoustic.core.wire.routing import RoutingRequest
from zacoustic.run.linefile import LineFile
from zacoustic.run.permitlog import utc_text
from zacoustic.run.privatefile import keep_private

MOST_BYTES: Final = 8 << 20
"""Length at which a log is renamed."""
HERE: Final = 0
"""In place of an address: this node's own network or program."""
_CALLS: Final = (
    "poll_event", "call", "reply", "reply_error", "commands.send", "commands.execute", "keys.send",
    "routing.send", "routing.execute",
    "actions.send_goal", "actions.accept", "actions.reject", "actions.finish",
    "actions.answer_cancel",
)  # fmt: skip
_UNDER_WAY: Final = 4096
"""Own calls without an outcome that are remembered; beyond that the oldest are forgotten."""

_logger = logging.getLogger(__name__)


class AuditEntry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line."""

    utc: str
    """When, UTC."""
    node: int
    """Address of the node that keeps the log."""
    by: int
    """Address of the node that requested it; 0: this node's own network or program."""
    what: str
    """``call``, ``goal``, ``cancel``, ``seal``, ``key``, or the kind of a command: ``silence``,
    ``resume``, ``tune``, ``reset``, ``ask``; ``command`` if it was refused unread."""
    outcome: str
    """``asked``, ``received``, ``answered``, ``executed``, ``accepted``, ``succeeded``, …,
    ``refused``, ``failed``."""
    about: str = ""
    """Name of the stream."""
    to: int = 0
    """Address of the node that was asked; 0: this node."""
    text: str = ""
    """The reason, one line."""
    sealed: bool = False
    """Frames are sealed, so `by` is authentic."""


class AuditLog:
    """The log of one node, for all of its engines.

    Args:
        path: The file.
        address: Address of the node.
        table: Its streams.
        utc_ns: Tells the time, ns since 1970.
        sealed: The node's frames are sealed.

    Raises:
        OSError: It cannot be written.
    """

    def __init__(
        self,
        path: Path,
        address: int,
        table: StreamTable,
        utc_ns: Callable[[], int],
        *,
        sealed: bool,
    ) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        keep_private(path)
        self._file = LineFile(path, "audit log", most_bytes=MOST_BYTES)
        self._address = address
        self._table = table
        self._utc_ns = utc_ns
        self._sealed = sealed
        self._own: OrderedDict[int, tuple[str, str, int]] = OrderedDict()

    def watch(self, engine: Engine) -> None:
        """Log the requests to an engine from now on."""
        self._own.clear()  # call ids are an engine's own
        Tap(engine, self._take, _CALLS)

    async def close(self) -> None:
        """Write the waiting lines and end the thread."""
        await self._file.close()

    # Below the methods above

    def _take(self, call: EngineCall) -> None:
        """Log a call of the engine; an error in here must not disturb the node."""
        try:
            for entry in self._entries(call):
                self._file.append(msgspec.json.encode(entry))
        except Exception:  # any error: the node goes on
            _logger.exception("audit log: %s is not noted", call.name)

    def _entries(self, call: EngineCall) -> Iterator[AuditEntry]:
        arguments = call.arguments
        if call.name == "poll_event":
            yield from self._of_event(call.result)
        elif call.error is not None:
            if call.name == "commands.execute":
                kind = arguments["command"].kind.value
                yield self._entry(HERE, kind, "refused", text=str(call.error))
        elif call.name == "commands.execute":
            command: RemoteCommand = arguments["command"]
            if command.changes:
                about = self._name(command.stream_id)
                yield self._entry(HERE, command.kind.value, "executed", about=about)
        elif call.name == "commands.send":
            command = arguments["command"]
            what, about = command.kind.value, self._name(command.stream_id)
            yield self._begin(call.result, what, about, arguments["node"])
        elif call.name == "keys.send":
            about = f"broadcasts of node {arguments['source']}"
            yield self._begin(call.result, "key", about, arguments["node"])
        elif call.name == "routing.send":
            what, about = _routing_words(arguments["request"])
            yield self._begin(call.result, what, about, arguments["node"])
        elif call.name == "routing.execute":
            if arguments["request"].changes:
                what, about = _routing_words(arguments["request"])
                yield self._entry(HERE, what, "executed", about=about)
        elif call.name == "call":
            spec = self._table.by_id(arguments["stream_id"]).spec
            server: int = (
                getattr(spec, "server", 0)
                if arguments.get("server") is None
                else arguments["server"]
            )
            yield self._begin(call.result, "call", self._name(arguments["stream_id"]), server)
        elif call.name in ("reply", "reply_error"):
            key = arguments["call"]
            failure = arguments.get("failure")
            yield self._entry(
                key.client,
                "call",
                "answered" if call.name == "reply" else "refused",
                about=self._name(key.stream_id),
                text=""
                if failure is None
                else f"{failure.name}: {arguments.get('text', '')}".rstrip(": "),
            )
        else:
            yield from self._of_goal(call)

    def _of_goal(self, call: EngineCall) -> Iterator[AuditEntry]:
        arguments = call.arguments
        if call.name == "actions.send_goal":
            goal: GoalKey = call.result
            server = getattr(self._table.by_id(goal.stream_id).spec, "server", 0)
            about = self._name(goal.stream_id)
            yield self._entry(HERE, "goal", "asked", about=about, to=server)
        elif call.result is not False:  # the goal existed
            outcome = {
                "actions.accept": "accepted",
                "actions.reject": "refused",
                "actions.finish": "",
                "actions.answer_cancel": "accepted" if arguments.get("accepted") else "refused",
            }[call.name]
            what = "cancel" if call.name == "actions.answer_cancel" else "goal"
            outcome = outcome or arguments["status"].name.lower()
            yield self._about_goal(arguments["goal"], what, outcome, arguments.get("text", ""))

    def _of_event(self, event: Any) -> Iterator[AuditEntry]:  # noqa: ANN401 (any event, or None)
        match event:
            case CommandHandled():
                yield self._entry(
                    event.commanded_by,
                    "command" if event.kind is None else event.kind.value,
                    "refused" if event.refusal else "executed",
                    about=self._name(event.stream_id),
                    text=event.refusal,
                )
            case RoutingHandled():
                what, about = (
                    ("route", "") if event.request is None else _routing_words(event.request)
                )
                outcome = "refused" if event.refusal else "executed"
                yield self._entry(
                    event.commanded_by, what, outcome, about=about, text=event.refusal
                )
            case KeyDelivered():
                outcome = "refused" if event.refusal else "executed"
                text = event.refusal or f"for broadcasts of node {event.source}"
                yield self._entry(event.delivered_by, "key", outcome, text=text)
            case RequestReceived():
                key = event.call
                yield self._entry(key.client, "call", "received", about=self._name(key.stream_id))
            case GoalReceived():
                yield self._about_goal(event.goal, "goal", "received")
            case CancelRequested():
                yield self._about_goal(event.goal, "cancel", "received")
            case ResponseReceived():
                yield from self._end(event.call_id, "answered")
            case CallFailed():
                text = f"{event.failure.name}: {event.text}".rstrip(": ")
                yield from self._end(event.call_id, "failed", text)
            case GoalAnswered():
                outcome = "accepted" if event.accepted else "refused"
                yield self._of_own_goal(event.goal, outcome, event.text)
            case ResultReceived():
                yield self._of_own_goal(event.goal, event.status.name.lower())
            case GoalFailed():
                yield self._of_own_goal(event.goal, "failed", event.text)
            case SealAlarm():
                text = f"{event.frames} frames"
                about = self._name(event.stream_id)
                yield self._entry(
                    event.address, "seal", event.refusal.value, about=about, text=text
                )
            case _:
                pass

    def _begin(self, call_id: int, what: str, about: str, server: int) -> AuditEntry:
        self._own[call_id] = what, about, server
        if len(self._own) > _UNDER_WAY:
            self._own.popitem(last=False)
        return self._entry(HERE, what, "asked", about=about, to=server)

    def _end(self, call_id: int, outcome: str, text: str = "") -> Iterator[AuditEntry]:
        found = self._own.pop(call_id, None)
        if found is not None:
            what, about, server = found
            yield self._entry(HERE, what, outcome, about=about, to=server, text=text)

    def _about_goal(self, goal: GoalKey, what: str, outcome: str, text: str = "") -> AuditEntry:
        return self._entry(goal.client, what, outcome, about=self._name(goal.stream_id), text=text)

    def _of_own_goal(self, goal: GoalKey, outcome: str, text: str = "") -> AuditEntry:
        server = getattr(self._table.by_id(goal.stream_id).spec, "server", 0)
        about = self._name(goal.stream_id)
        return self._entry(HERE, "goal", outcome, about=about, to=server, text=text)

    def _name(self, stream_id: int | None) -> str:
        stream = None if stream_id is None else self._table.get(stream_id)
        return "" if stream is None else stream.name

    def _entry(
        self, by: int, what: str, outcome: str, *, about: str = "", to: int = 0, text: str = ""
    ) -> AuditEntry:
        return AuditEntry(
            utc=utc_text(self._utc_ns()),
            node=self._address,
            by=by,
            what=what,
            outcome=outcome,
            about=about,
            to=to,
            text=text,
            sealed=self._sealed,
        )


def _routing_words(request: RoutingRequest) -> tuple[str, str]:
    """Return what a command about routes does, and about what."""
    about = f"route {request.route_id}" if request.route_id else f"run {request.run}"
    if request.path:
        about += f": {', '.join(map(str, request.path))}"
    return f"route_{request.kind.name.lower()}", about


def audit_path(journal: Path) -> Path:
    """Return the audit log that belongs to the file of a journal."""
    return journal.with_suffix(".audit")


def read_audit(path: Path) -> Iterator[AuditEntry]:
    """Read a log, older part first; skips lines that are not entries.

    Raises:
        OSError: It cannot be read.
    """
    for each in (path.with_name(f"{path.name}.1"), path):
        if each != path and not each.exists():
            continue
        with each.open("rb") as file:
            for line in file:
                try:
                    yield msgspec.json.decode(line, type=AuditEntry)
                except msgspec.DecodeError:
                    continue
