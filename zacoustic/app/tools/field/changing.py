"""Gives a route another path while it is used: asks all nodes, then tells relays, then the ends."""

from collections.abc import Callable, Collection, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.field.probing import Asker
from zacoustic.core.wire.relay import LAST_ROUTE
from zacoustic.core.wire.routing import REVISIONS, RoutingKind, RoutingRequest
from zacoustic.errors import CallTimeoutError, DeliveryError, ServiceError
from zacoustic.zenoh.requests.routing import RoutingReport

_HALF: Final = REVISIONS // 2


class PathChanged(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a change."""

    route: int
    """The route."""
    revision: int
    """Of the change."""
    number: int
    """What frames on the path have as the number of the route."""
    path: tuple[int, ...]
    """The path."""
    done: tuple[int, ...]
    """Nodes that have it, in the order in which they were told."""
    failed: int = 0
    """The node that has not confirmed it; those after it were not told. 0: all have it."""
    why: str = ""
    """Why not."""
    timed_out: bool = False
    """It has not answered, and may have it."""


async def change_path(
    asker: Asker,
    route_id: int,
    path: tuple[int, ...],
    *,
    undo: bool = False,
    nodes: Collection[int] = (),
    taken: Collection[int] = (),
    timeout_s: float,
    tell: Callable[[str], None] = lambda text: None,
) -> PathChanged:
    """Change the path of a route.

    Args:
        asker: Gives the commands.
        route_id: The route.
        path: The new path; to undo, that of the file.
        undo: Go back to the path of the file.
        nodes: Only these nodes; empty: those of the path, and to undo those of the present one.
        taken: Numbers of routes and bonds.
        timeout_s: How long to try each hop of a question, s.
        tell: Takes a line on progress.

    Raises:
        CallTimeoutError, ServiceError, DeliveryError, LocalError: A node cannot be asked; nothing
            has changed.
    """
    own = await asker.own()
    known: dict[int, RoutingReport] = {}

    async def ask(node: int, request: RoutingRequest) -> RoutingReport:
        via = _between(own, node, path if node in path else present)
        request = msgspec.structs.replace(request, via=via)
        try:
            return await asker.ask(node, request, timeout_s * (1 + len(via)))
        except CallTimeoutError:
            raise CallTimeoutError(f"node {node} has not answered") from None
        except ServiceError as error:
            raise ServiceError(f"node {node}: {error}") from None

    present = path
    question = RoutingRequest(kind=RoutingKind.ASK, route_id=route_id)
    if own in path:
        known[own] = await ask(own, question)
        present = known[own].path
    concerned = set(nodes) or ({*path, *present} if undo else set(path))
    # The nearer ones first: those further away are asked over them.
    order = sorted(concerned, key=lambda node: (len(_between(own, node, path)), node))
    for node in order:
        if node not in known:
            known[node] = await ask(node, question)
        tell(f"node {node}: revision {known[node].revision}, path {list(known[node].path)}")
    revision = (_latest([each.revision for each in known.values()]) + 1) % REVISIONS or 1
    used = {*taken, *(each.number for each in known.values())}
    number = route_id if undo else _free(used, known)
    command = RoutingRequest(
        kind=RoutingKind.RESET if undo else RoutingKind.SET,
        route_id=route_id,
        revision=revision,
        number=number if not undo else 0,
        path=path if not undo else (),
    )
    ends = {path[0], path[-1]}
    first = [node for node in order if node not in ends]
    last = [node for node in order if node in ends and node != own] + [own] * (
        own in concerned & ends
    )
    done: list[int] = []
    changed = PathChanged(route=route_id, revision=revision, number=number, path=path, done=())
    for node in [*last, *first] if undo else [*first, *last]:
        try:
            await ask(node, command)
        except (CallTimeoutError, ServiceError, DeliveryError) as error:
            return msgspec.structs.replace(
                changed,
                done=tuple(done),
                failed=node,
                why=str(error),
                timed_out=isinstance(error, CallTimeoutError),
            )
        done.append(node)
        tell(f"node {node} has revision {revision}")
    return msgspec.structs.replace(changed, done=tuple(done))


def _between(own: int, node: int, path: Sequence[int]) -> tuple[int, ...]:
    """Return the nodes of a path between two of its nodes, in order; empty: one is not in it."""
    if own not in path or node not in path:
        return ()
    start, end = path.index(own), path.index(node)
    if start <= end:
        return tuple(path[start + 1 : end])
    return tuple(reversed(path[end + 1 : start]))


def _latest(revisions: Sequence[int]) -> int:
    latest = revisions[0]
    for each in revisions:
        if 0 < (each - latest) % REVISIONS < _HALF:
            latest = each
    return latest


def _free(used: Collection[int], known: dict[int, RoutingReport]) -> int:
    """Return the next free number below the one used last, so that none is used again soon.

    Raises:
        DeliveryError: There is none.
    """
    numbers = [each.number for each in known.values() if each.revision]
    last: int = min(numbers, default=LAST_ROUTE + 1)
    order: list[int] = [*range(last - 1, 0, -1), *range(LAST_ROUTE, last - 1, -1)]
    for number in order:
        if number not in used:
            return number
    raise DeliveryError("all numbers of routes are in use")
