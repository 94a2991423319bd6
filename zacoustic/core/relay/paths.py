"""Paths of routes that commands have changed; they survive a restart, and change no digest.

The problem: no two nodes change at the same instant, and frames are on their way. With one number
for both paths a frame would run in a ring, or two relays would each take the other for the next
one, and both would forget it.

The idea: **another path has another number on the wire.** A node that has been told both transmits
and passes on what belongs to either. So the relays are told first, then the far end, then the near
one: each end changes over when its command arrives, and hears by both. Whoever has not got the
command ignores what has the new number. The ends stay the same, and so does the lifetime of a
frame: the two ends see the same link as before.

Each change of a route has a *revision*. A node takes none that is not later than the last one it
knows, so a late or repeated command changes nothing.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.journal import JournalPort
from zacoustic.core.relay.relay import Relay
from zacoustic.core.relay.route import Route
from zacoustic.core.wire.routing import REVISIONS
from zacoustic.errors import ConfigError, LocalError

_JOURNAL: Final = "path"


class PathState(msgspec.Struct, frozen=True, array_like=True):
    """The present path of a route at this node."""

    revision: int
    """Of the last change; 0: there was none."""
    number: int
    """What its frames have as the number of the route."""
    path: tuple[int, ...]
    """Its nodes."""


class Paths:
    """The paths of the routes of one node.

    Args:
        address: Address of the node.
        routes: The routes of its file.
        taken: Numbers of bonds.
        relays: Its part in the routes, by link; a node without one of the links lacks that.
        stored: The content of the journal.
        journal: Holds the changes.
    """

    def __init__(
        self,
        address: int,
        routes: Sequence[Route],
        taken: Collection[int],
        relays: Mapping[str, Relay],
        stored: Mapping[str, bytes],
        journal: JournalPort,
    ) -> None:
        self._address = address
        self._routes = {each.route_id: each for each in routes}
        self._taken = {*self._routes, *taken}
        self._relays = relays
        self._journal = journal
        self._states: dict[int, PathState] = {}
        self._rows: dict[int, Route] = {}
        """The changed paths that this node knows, by their numbers."""
        self._former: dict[int, int] = {}
        """The instant since which a changed path is not the present one, by its number, ns."""
        for key, value in stored.items():
            head, _, route_id = key.partition("/")
            if head == _JOURNAL:
                self._recover(int(route_id), value)

    def state(self, route_id: int) -> PathState:
        """Return the present path of a route.

        Raises:
            LocalError: The file has no such route.
        """
        route = self._route(route_id)
        return self._states.get(route_id) or PathState(0, route_id, route.path)

    @property
    def changed(self) -> dict[str, PathState]:
        """The routes that do not have the path of the file, by name."""
        return {
            self._routes[route_id].name: state
            for route_id, state in self._states.items()
            if state.number != route_id
        }

    def set(
        self,
        route_id: int,
        revision: int,
        number: int,
        path: tuple[int, ...],
        now: int,
        then: Callable[[int], None],
    ) -> None:
        """Give a route another path; call `then` once that is journalled.

        Args:
            route_id: The route of the file.
            revision: Of this change.
            number: What frames on the path have as the number of the route.
            path: Its nodes, with the ends of the file's path.
            now: The instant, ns.
            then: Takes the instant.

        Raises:
            LocalError: The file has no such route, the path has other ends, takes too long or has a
                number that is in use, or a later change is known.
        """
        wanted = PathState(revision, number, path)
        if self._is_known(route_id, wanted):
            then(now)
            return
        row = self._row(self._route(route_id), wanted)
        self._drop_former(now)
        if self._rows.get(number, row).path != path or self._is_of_another(number, route_id):
            raise LocalError(f"number {number} is in use for another path")
        self._leave(route_id, now)
        self._enter(route_id, wanted, row, now)
        self._write(route_id, wanted, then)

    def reset(self, route_id: int, revision: int, now: int, then: Callable[[int], None]) -> None:
        """Give a route the path of the file again; as `set`.

        Raises:
            LocalError: The file has no such route, or a later change is known.
        """
        route = self._route(route_id)
        wanted = PathState(revision, route_id, route.path)
        if self._is_known(route_id, wanted):
            then(now)
            return
        self._leave(route_id, now)
        self._states[route_id] = wanted
        relay = self._relays.get(route.link)
        if relay is not None and self._address in route.path:
            relay.use(route_id, route_id, now)
        self._write(route_id, wanted, then)

    # Below the methods above

    def _route(self, route_id: int) -> Route:
        route = self._routes.get(route_id)
        if route is None:
            raise LocalError(f"no route {route_id} in the file")
        return route

    def _is_known(self, route_id: int, wanted: PathState) -> bool:
        """Return whether a change is the last one; refuse one that is not later."""
        self._route(route_id)
        last = self._states.get(route_id)
        if last is None or last == wanted:
            return last is not None
        if not 0 < (wanted.revision - last.revision) % REVISIONS < REVISIONS // 2:
            raise LocalError(f"overtaken: revision {last.revision} is known")
        return False

    def _row(self, route: Route, wanted: PathState) -> Route:
        """Return a changed path as a route of its own.

        Raises:
            LocalError: It has other ends, takes too long, or has a number of the file.
        """
        if (wanted.path[0], wanted.path[-1]) != (route.path[0], route.path[-1]):
            raise LocalError(f"a path from {route.path[0]} to {route.path[-1]} is allowed")
        if wanted.number in self._taken:
            raise LocalError(f"number {wanted.number} is in use")
        try:
            row = msgspec.structs.replace(
                route, route_id=wanted.number, path=wanted.path, lifetime_s=route.longest_s
            )
        except ConfigError as error:
            raise LocalError(str(error)) from None
        relay = self._relays.get(route.link)
        if relay is None and self._address in wanted.path:
            raise LocalError(f"this node has no link {route.link}")
        if relay is not None and not relay.is_in_time(row, route):
            raise LocalError(f"{row.hops} hops take too long for it")
        return row

    def _is_of_another(self, number: int, route_id: int) -> bool:
        row = self._rows.get(number)
        return row is not None and row.name != self._routes[route_id].name

    def _enter(self, route_id: int, wanted: PathState, row: Route, now: int) -> None:
        self._states[route_id] = wanted
        self._rows[wanted.number] = row
        self._former.pop(wanted.number, None)
        relay = self._relays.get(row.link)
        if relay is not None and self._address in row.path:
            relay.add(row)
            relay.use(route_id, wanted.number, now)

    def _leave(self, route_id: int, now: int) -> None:
        """Record that the present path is a former one: what is on its way there still arrives."""
        state = self._states.get(route_id)
        if state is not None and state.number != route_id:
            self._former[state.number] = now

    def _drop_former(self, now: int) -> None:
        """Forget the paths on which nothing is on its way any more."""
        for number, since in list(self._former.items()):
            row = self._rows[number]
            if now - since > 2 * seconds_to_ns(row.longest_s):
                del self._former[number], self._rows[number]
                relay = self._relays.get(row.link)
                if relay is not None:
                    relay.drop(number, now)

    def _write(self, route_id: int, state: PathState, then: Callable[[int], None]) -> None:
        self._journal.write(f"{_JOURNAL}/{route_id}", msgspec.msgpack.encode(state), then)

    def _recover(self, route_id: int, value: bytes) -> None:
        try:
            route = self._route(route_id)
            state = msgspec.msgpack.decode(value, type=PathState)
            if state.number == route_id:  # reset: only the revision is needed
                self._states[route_id] = PathState(state.revision, route_id, route.path)
            else:
                self._enter(route_id, state, self._row(route, state), 0)
        except (LocalError, msgspec.MsgspecError):
            # The file has changed.
            self._journal.write(f"{_JOURNAL}/{route_id}", None)
