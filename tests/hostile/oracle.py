"""`Oracle`: what must hold, from nothing but what applications gave and what they were handed.

It shares no code with the engine: it knows tickets, and who gave them when. What a node may have
forgotten (it was killed before a commit, its journal was restored or damaged) is told to it.
"""

from typing import Any, Final

import msgspec

from tests.hostile import fleet

LONGEST_S: Final = {fleet.ARM: 310.0, fleet.GOTO: 820.0, 175: 310.0}
"""Time within which a call, a goal, an order has an end, s: the time-outs of `fleet`, with 10 s, or
a tenth part, for timers of clocks that drift and for what waits for a commit. A client that was
killed asks for its goals again, with the whole time-out: no clock is trusted over a restart."""
COPIED_S: Final = 35.0
"""Time within which a best-effort sample may come again after a restart of its receiver, s. Copies
of an urgent one go for 30 s, as docs/wire.md says; and one frame is slow. On a route the first node
tries for its lifetime, and each hop for its part of that. A flood has `FLOODED_S` for each hop."""
FLOODED_S: Final = 60.0


class Given(msgspec.Struct):
    """A sample, a call, a goal or an order that an engine has accepted."""

    node: int
    life: int
    stream_id: int
    instance: tuple[int, ...]
    value: Any
    at_s: float
    name: object
    """What the engine calls it: delivery id, call id, goal key."""
    is_forgotten: bool = False
    """Its node was killed, and may know nothing of it."""
    ends: list[str] = []
    ended_in: int = 0
    """The life in which the last end was told."""
    handed_on: dict[int, list[int]] = {}
    """Node → the lives in which it was handed on there."""
    first_s: float | None = None
    """When it was handed on first, anywhere."""


class Oracle:
    """What was given, and what came of it.

    Args:
        addresses: All nodes.
        doubles: Best-effort samples may come twice: the modem hands frames over twice.
        lifetime_s: The longest lifetime of a frame on routes and floods, s.
        strangers: Another fleet has the same addresses. Frames that do not say whose they are, as
            most do once two nodes know each other, are taken for those of this fleet until frames
            are sealed: what strangers give is ignored here, an ACK of theirs is believed, and so is
            their count.
    """

    def __init__(
        self, addresses: tuple[int, ...], *, doubles: bool, strangers: bool, lifetime_s: float = 0.0
    ) -> None:
        self.violations: list[str] = []
        self.given: dict[int, Given] = {}
        """By ticket."""
        self._killed_s: dict[int, float] = {}
        """When each node was killed last."""
        self.forgetful: set[int] = set()
        """Nodes whose journal was restored or damaged: they may do again what they did before."""
        self._addresses = addresses
        self._doubles = doubles
        self._copied_s = COPIED_S + 2 * lifetime_s
        self._strangers = strangers
        self._by_name: dict[tuple[int, int, str, object], Given] = {}
        self.counts: dict[str, int] = {}
        self._delivered: list[Given] = []

    def complain(self, text: str) -> None:
        """Note what must not have happened."""
        self.violations.append(text)

    def give(self, ticket: int, kind: str, given: Given) -> None:
        """Something was accepted; `kind` is ``sample``, ``call`` or ``goal``."""
        self.given[ticket] = given
        self._by_name[given.node, 0 if kind == "goal" else given.life, kind, given.name] = given
        self._count(f"{kind}s given")

    def hand_on(
        self,
        node: int,
        life: int,
        source: int,
        stream_id: int,
        instance: tuple[int, ...],
        value: Any,
        *,
        now_s: float = 0.0,
        again: bool = False,
    ) -> int | None:
        """An application was handed a sample, a request or a goal; returns its ticket.

        `now_s`: when. `again`: it was told that it may have had it before its node was killed.
        """
        ticket = fleet.ticket_of(value)
        given = None if ticket is None else self.given.get(ticket)
        where = f"node {node} gets {value!r:.60} of node {source} on stream {stream_id}"
        told = given and (given.node, given.stream_id, given.instance, given.value)
        if self._strangers and told != (source, stream_id, instance, value):
            self._count("of strangers")
            return None
        if given is None:
            self.complain(f"{where}: nobody has given that")
            return None
        if told != (source, stream_id, instance, value):
            self.complain(f"{where}: given was {told!r:.120}")
        lives = given.handed_on.setdefault(node, [])
        is_again = life in lives if stream_id in (fleet.LIGHT,) else bool(lives)
        is_best_effort = stream_id in fleet.BEST_EFFORT
        is_allowed = node in self.forgetful or self._strangers or (is_best_effort and self._doubles)
        is_next_life = life > max(lives, default=life)
        given.first_s = now_s if given.first_s is None else given.first_s
        is_copy = is_best_effort and now_s - given.first_s <= self._copied_s
        is_allowed |= is_next_life and (again or is_copy)
        if is_again and not is_allowed:
            self.complain(f"{where}: a second time, given at {given.at_s:.1f} s")
        lives.append(life)
        self._count(f"stream {stream_id} handed on")
        return ticket

    def end(
        self, node: int, life: int, kind: str, name: object, how: str, now_s: float = 0.0
    ) -> None:
        """An application was told, at an instant, how something ended."""
        given = self._find(node, life, kind, name)
        if given is None:
            if node not in self.forgetful:
                self.complain(f"node {node} is told {how} of a {kind} {name} that it has not given")
            return
        if given.ends == [how] and life > given.ended_in:
            return  # a crash between the event and the next one: told again, and the same
        given.ends.append(how)
        given.ended_in = life
        begun_s = max(given.at_s, self._killed_s.get(node, 0.0) if kind == "goal" else 0.0)
        took_s, most_s = now_s - begun_s, LONGEST_S.get(given.stream_id)
        if most_s is not None and took_s > most_s and node not in self.forgetful:
            self.complain(f"node {node}: {kind} {name} {how} after {took_s:.0f} of {most_s:.0f} s")
        self._count(f"{kind} {how}")
        if len(given.ends) > 1 and node not in self.forgetful:
            self.complain(f"node {node}: {kind} {name} ends {' and '.join(given.ends)}")
        if how == "delivered" and given.stream_id != fleet.DIARY and not self._strangers:
            self._delivered.append(given)

    def excuse(self, node: int, life: int, kind: str, name: object) -> None:
        """An application may never be told how something ended."""
        given = self._find(node, life, kind, name)
        if given is not None:
            given.is_forgotten = True

    def excuse_receiver(self, node: int, life: int, value: Any) -> None:
        """A node dies with a sample that its journal does not have: it may never hand that on."""
        ticket = fleet.ticket_of(value)
        given = None if ticket is None else self.given.get(ticket)
        if given is not None:
            given.handed_on.setdefault(node, []).append(life)

    def killed(
        self, node: int, life: int, is_journalled: "dict[int, bool]", *, now_s: float
    ) -> None:
        """A node was killed.

        Args:
            node: Its address.
            life: Its life until now.
            is_journalled: Ticket → whether it was in the journal when the node was killed.
            now_s: When.
        """
        self._killed_s[node] = now_s
        for ticket, given in self.given.items():
            if given.node == node and given.life == life and not is_journalled.get(ticket, False):
                given.is_forgotten = True

    def check_ends(self) -> None:
        """All is over: everything has ended, once, and what was told to be delivered is.

        A receiver that is killed with a sample in its journal hands it on in its next life.
        """
        for given in self._delivered:
            receivers = {fleet.SERVER} if given.stream_id == fleet.STOP else {*self._addresses}
            lacking = receivers - {given.node} - set(given.handed_on) - self.forgetful
            if lacking:
                self.complain(
                    f"node {given.node} is told that {given.value!r:.40} on stream "
                    f"{given.stream_id} of {given.at_s:.1f} s is delivered; node {sorted(lacking)} "
                    "never got it"
                )
        for given in self.given.values():
            is_awaited = given.stream_id not in fleet.BEST_EFFORT
            if is_awaited and not given.ends and not given.is_forgotten:
                got = sorted(given.handed_on)
                self.complain(
                    f"node {given.node}, life {given.life}: nothing is told of {given.name} on "
                    f"stream {given.stream_id} of {given.at_s:.1f} s; handed on at {got}"
                )

    def _find(self, node: int, life: int, kind: str, name: object) -> Given | None:
        if kind == "goal":
            return self._by_name.get((node, 0, kind, name))
        if kind == "call":
            return self._by_name.get((node, life, kind, name))
        # The id of a sample that went on in a later life is that of the life that has given it.
        for former in range(life, 0, -1):
            given = self._by_name.get((node, former, kind, name))
            if given is not None and (former == life or not given.is_forgotten):
                return given
        return None

    def _count(self, what: str) -> None:
        self.counts[what] = self.counts.get(what, 0) + 1
