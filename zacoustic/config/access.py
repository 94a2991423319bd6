"""The table `access` of a link: its medium access, checked as far as the file allows.

Checks that depend on the link (whether it senses carriers, the time of its largest frame) come when
it opens, in `zacoustic.core.schedule.access.choose`.
"""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any, Final

from zacoustic.config.problems import Place, shown
from zacoustic.config.sections import ALLOWED
from zacoustic.core.schedule.access.spec import (
    METHODS,
    AccessSpec,
    AlohaSpec,
    AutoSpec,
    CarrierSenseSpec,
    DelegatedSpec,
    PollingSpec,
    ScheduleSpec,
    TdmaSpec,
)

_AUTO: Final = "auto"
_METHODS_SHOWN = ", ".join(f'"{method}"' for method in METHODS)


def read_access(
    place: Place, written: Mapping[str, Any] | str | None, nodes: Mapping[int, str]
) -> AccessSpec | None:
    """Read the table at `place`.

    Args:
        place: Place of the table.
        written: Its content, or the word "auto"; None: there is no table.
        nodes: Name of each node by address; empty if the fleet is not listed.

    Raises:
        ConfigError: The table is wrong, or cannot work.
    """
    if written is None:
        return None
    if isinstance(written, str):
        if written != _AUTO:
            place.refuse(shown(written), allowed=ALLOWED["access"])
        return AutoSpec()
    method = written.get("method")
    if method is None:
        place.at("method").refuse("is missing", allowed=_METHODS_SHOWN)
    if not isinstance(method, str) or method not in METHODS:
        close = get_close_matches(str(method), METHODS, 1)
        hint = f'did you mean "{close[0]}"?' if close else ""
        place.at("method").refuse(shown(method), allowed=_METHODS_SHOWN, hint=hint)
    has_slots = method in ("tdma", "schedule") or (method == _AUTO and written.get("slots"))
    if has_slots and written.get("clock_error_s") is None:
        place.at("clock_error_s").refuse(
            "is missing, and slots need clocks whose error is known",
            allowed="seconds, 0 or more",
            hint="how wrong may the clock of a node be? NTP at the surface: 0.01",
        )
    spec = place.convert(METHODS[method])
    match spec:
        case TdmaSpec():
            _check_nodes(place.at("slots"), spec.slots, nodes)
            if spec.clock is not None:
                _check_node(place.at("clock"), spec.clock, nodes)
        case ScheduleSpec() | AutoSpec():
            for index, slot in enumerate(spec.slots):
                _check_nodes(place.at("slots").at(index).at("owners"), slot.owners, nodes)
            if spec.clock is not None:
                _check_node(place.at("clock"), spec.clock, nodes)
        case PollingSpec():
            _check_node(place.at("poller"), spec.poller, nodes)
            _check_nodes(place.at("nodes"), spec.nodes, nodes)
        case AlohaSpec() | CarrierSenseSpec() | DelegatedSpec():
            pass
    return spec


def _check_nodes(place: Place, addresses: tuple[int, ...], nodes: Mapping[int, str]) -> None:
    for index, address in enumerate(addresses):
        _check_node(place.at(index), address, nodes)


def _check_node(place: Place, address: int, nodes: Mapping[int, str]) -> None:
    if nodes and address not in nodes:
        known = ", ".join(f"{known} ({name})" for known, name in nodes.items())
        place.refuse(f"{address} is no node", allowed=known, hint="add it to nodes")
