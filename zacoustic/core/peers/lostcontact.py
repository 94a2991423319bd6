"""Lost contact: the instant from which a node must act because it hears nobody.

A vehicle that has lost its crew must surface, or abort. `zacoustic.core.peers.contact` reports each
node that is silent; this is the safety function built on the same frames: a *rule* names the nodes
that keep this one at work, and how long all of them may be silent. The engine only says when; the
shell acts, and reports with `acted` that the local program has answered.

::

    counting ── silence of lost_after_s: ContactLost ──► lost ── acted ──► acted
        ▲                                                  │                 │
        └────────── a frame: ContactRestored ──────────────┴─────────────────┘

- Contact is a frame that can be opened: with a seal an authentic one, without a seal any readable
  one in the name of the node. A frame that is accepted without a seal on a sealed link
  (`emergency`) is none, and neither is a modem's acknowledgement.
- Nothing stops the countdown: no silence of either side, no quiet window, no link that is down. It
  uses the monotonic clock, so setting a clock changes nothing. It begins with the first input, also
  if nobody was ever heard.
- Each rule acts once per loss. Contact arms it again.

**Restarts.** The journal has how long the silence lasted at an instant. On the same run of the
monotonic clock the countdown goes on as if there had been no restart. After another one the time in
between is unknown: it goes on with what was written, plus the longest time that may have passed
since then while the node ran (`_WRITE_PARTS`). So each start, however short, shortens it, and a
node that crashes again and again acts in the end. Contact is written as rarely; a restart may thus
take the silence for longer than it is, by that part, never for shorter.

A loss without an answer is reported again. So is one with an answer if the computer was started
again, since the program that answered may have forgotten; if the rule has changed; and if the
journal is in doubt. A node without a journal forgets all that with its process.
"""

import enum
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.journal import BOOT_KEY, DOUBT_KEY, JournalPort
from zacoustic.core.base.timers import Due, Timers

LOST_CONTACT_KEY: Final = "lost_contact/"
"""Beginning of the keys in the journal; the name of the rule follows."""
_WRITE_PARTS: Final = 16
"""The silence is journalled again after this part of `lost_after_s`: few commits, and a node that
restarts all the time acts after this many starts."""
_LEAST_WRITE_NS: Final = seconds_to_ns(1)


class LostContactRule(msgspec.Struct, frozen=True, kw_only=True):
    """When a node must act because it hears nobody."""

    name: str
    """Name of the rule, unique at the node."""
    nodes: tuple[int, ...] = ()
    """Any frame of one of these nodes is contact; empty: of any other node."""
    lost_after_s: float
    """Silence of all of them after which contact is lost, s."""


class ContactPhase(enum.Enum):
    """Where a rule is."""

    COUNTING = "counting"
    """Contact is not lost; the countdown runs since the last frame."""
    LOST = "lost"
    """Contact is lost, and the action has no answer yet."""
    ACTED = "acted"
    """Contact is lost, and the action has its answer."""


class ContactLost(msgspec.Struct, frozen=True, kw_only=True):
    """None of the nodes of a rule was heard for its time: act now, and until it is answered."""

    name: str
    """The rule."""
    silent_since: int
    """Instant of the last frame, or of the first start, ns; negative: before this start."""
    lost_at: int
    """Instant of this event, ns."""


class ContactRestored(msgspec.Struct, frozen=True, kw_only=True):
    """A node of a rule is heard again after a loss; the rule is armed again."""

    name: str
    """The rule."""
    source: int
    """The node that was heard."""
    restored_at: int
    """Instant of its frame, ns."""
    acted: bool
    """Whether the action had its answer."""


class Countdown(msgspec.Struct, frozen=True, kw_only=True):
    """The state of one rule."""

    rule: LostContactRule
    """The rule."""
    phase: ContactPhase
    """Where it is."""
    silent_since: int
    """Instant of the last frame, or of the first start, ns; negative: before this start."""
    acts_at: int
    """Instant at which contact is lost, or was, ns."""


class _Entry(msgspec.Struct, frozen=True, array_like=True):
    """A rule in the journal."""

    written_at: int
    boot: bytes
    """The run of the monotonic clock that `written_at` belongs to; empty: unknown."""
    silent_ns: int
    """How long the silence had lasted at `written_at`, ns."""
    acted: bool
    nodes: tuple[int, ...]
    lost_after_ns: int


class _Rule:
    """The variables of one rule."""

    def __init__(self, rule: LostContactRule) -> None:
        self.rule = rule
        self.lost_after_ns = seconds_to_ns(rule.lost_after_s)
        self.write_every_ns = max(_LEAST_WRITE_NS, self.lost_after_ns // _WRITE_PARTS)
        self.phase = ContactPhase.COUNTING
        self.silent_since = 0
        self.written_at = 0


class LostContact:
    """The rules of one node, over all its links.

    Args:
        address: Address of the node.
        rules: The rules.
        stored: The content of the journal.
        journal: Holds the countdowns.
        timers: Fire when contact is lost.
        emit: Takes events.
    """

    def __init__(
        self,
        address: int,
        rules: tuple[LostContactRule, ...],
        stored: Mapping[str, bytes],
        *,
        journal: JournalPort,
        timers: Timers,
        emit: Callable[[ContactLost | ContactRestored], None],
    ) -> None:
        self._address = address
        self._rules = {rule.name: _Rule(rule) for rule in rules}
        self._journal = journal
        self._timers = timers
        self._emit = emit
        self._boot = stored.get(BOOT_KEY, b"")
        self._is_in_doubt = DOUBT_KEY in stored
        self._stored = {
            key.removeprefix(LOST_CONTACT_KEY): each
            for key, each in stored.items()
            if key.startswith(LOST_CONTACT_KEY)
        }
        self._has_begun = False

    def begin(self, now: int) -> None:
        """Begin or continue the countdowns at the first input; later calls have no effect."""
        if self._has_begun:
            return
        self._has_begun = True
        for name in self._stored.keys() - self._rules.keys():
            self._journal.write(LOST_CONTACT_KEY + name, None)
        for name, each in self._rules.items():
            self._recover(each, _read(self._stored.get(name)), now)
            self._write(each, now)
            self._arm(each)

    def heard(self, source: int, now: int) -> None:
        """Note a frame of a node that could be opened."""
        if source == self._address:
            return
        for name, each in self._rules.items():
            if each.rule.nodes and source not in each.rule.nodes:
                continue
            before, each.phase = each.phase, ContactPhase.COUNTING
            each.silent_since = now
            if before is not ContactPhase.COUNTING:
                self._write(each, now)
                acted = before is ContactPhase.ACTED
                self._emit(ContactRestored(name=name, source=source, restored_at=now, acted=acted))
            elif now - each.written_at >= each.write_every_ns:
                self._write(each, now)
            self._arm(each)

    def acted(self, name: str, now: int) -> bool:
        """Record that the action of a loss has its answer; False: there is no such loss now."""
        each = self._rules.get(name)
        if each is None or each.phase is not ContactPhase.LOST:
            return False
        each.phase = ContactPhase.ACTED
        self._write(each, now)
        return True

    def countdowns(self) -> tuple[Countdown, ...]:
        """Return the state of each rule."""
        return tuple(
            Countdown(
                rule=each.rule,
                phase=each.phase,
                silent_since=each.silent_since,
                acts_at=each.silent_since + each.lost_after_ns,
            )
            for each in self._rules.values()
        )

    # Below the methods above

    def _recover(self, each: _Rule, entry: _Entry | None, now: int) -> None:
        """Set a rule to what the journal says."""
        each.silent_since = now
        if entry is None:
            return
        is_same_boot = bool(self._boot) and self._boot == entry.boot and now >= entry.written_at
        passed_ns = now - entry.written_at if is_same_boot else each.write_every_ns
        each.silent_since = now - max(0, entry.silent_ns) - passed_ns
        is_same_rule = (entry.nodes, entry.lost_after_ns) == (each.rule.nodes, each.lost_after_ns)
        if entry.acted and is_same_boot and is_same_rule and not self._is_in_doubt:
            each.phase = ContactPhase.ACTED

    def _arm(self, each: _Rule) -> None:
        name = each.rule.name
        if each.phase is ContactPhase.COUNTING:
            acts_at = each.silent_since + each.lost_after_ns
            write_at = each.written_at + each.write_every_ns
            self._timers.at((Due.LOST_CONTACT, name), acts_at, partial(self._lose, each))
            self._timers.at((Due.LOST_CONTACT, name, ""), write_at, partial(self._keep, each))

    def _lose(self, each: _Rule, now: int) -> None:
        each.phase = ContactPhase.LOST
        self._timers.cancel((Due.LOST_CONTACT, each.rule.name, ""))
        self._write(each, now)
        self._emit(ContactLost(name=each.rule.name, silent_since=each.silent_since, lost_at=now))

    def _keep(self, each: _Rule, now: int) -> None:
        """Journal how long the silence has lasted so far."""
        self._write(each, now)
        self._arm(each)

    def _write(self, each: _Rule, now: int) -> None:
        each.written_at = now
        entry = _Entry(
            written_at=now,
            boot=self._boot,
            silent_ns=now - each.silent_since,
            acted=each.phase is ContactPhase.ACTED,
            nodes=each.rule.nodes,
            lost_after_ns=each.lost_after_ns,
        )
        self._journal.write(LOST_CONTACT_KEY + each.rule.name, msgspec.msgpack.encode(entry))


def _read(stored: bytes | None) -> _Entry | None:
    """Read an entry; None: there is none, or another version has written it."""
    if stored is None:
        return None
    try:
        return msgspec.msgpack.decode(stored, type=_Entry)
    except msgspec.DecodeError:
        return None
