"""Reduces a scenario to its first nodes: how a campaign sweeps their number."""

from typing import Any, Final

_NAMING: Final = ("node", "from", "to")
"""Keys with the address of a node."""


def keep_first(scenario: Any, count: object) -> None:  # noqa: ANN401 (of JSON)
    """Keep the first nodes, and the links, faults and traffic that concern only them.

    Args:
        scenario: As read; changed in place.
        count: Number of nodes to keep.

    Raises:
        ValueError: There are fewer nodes.
    """
    nodes = scenario.get("nodes") if isinstance(scenario, dict) else None
    if not isinstance(nodes, list):
        raise ValueError("nodes is no array; allowed: a scenario with nodes")
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= len(nodes):
        raise ValueError(f"nodes.count is {count!r}; allowed: 1 to {len(nodes)}, a whole number")
    gone = {node.get("address") for node in nodes[count:] if isinstance(node, dict)}
    del nodes[count:]
    for key in ("links", "traffic"):
        _drop(scenario, key, gone)
    faults = scenario.get("faults")
    if isinstance(faults, dict):
        for key in ("blackouts", "unplugged", "crashes", "clocks"):
            _drop(faults, key, gone)
        if isinstance(journal := faults.get("journal"), dict):
            _drop(journal, "fails", gone)


def _drop(table: dict[str, Any], key: str, gone: set[Any]) -> None:
    entries = table.get(key)
    if isinstance(entries, list):
        table[key] = [entry for entry in entries if not _is_about(entry, gone)]


def _is_about(entry: object, gone: set[Any]) -> bool:
    if not isinstance(entry, dict):
        return False
    pair = entry.get("pair")
    named = [entry.get(key) for key in _NAMING] + (pair if isinstance(pair, list) else [])
    return any(isinstance(address, int) and address in gone for address in named)
