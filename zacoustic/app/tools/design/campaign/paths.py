"""Dotted paths of the values that a campaign changes, in the form of error messages.

``loss.frame``, ``nodes[1].position[0]``, ``traffic[*].every_s`` (of each entry). Objects on the way
that the file omits are made; an entry of an array must exist.
"""

import re
from typing import Any, Final

Step = str | int
"""A key; or an index of an array, `EACH` for all of them."""
EACH: Final = -1
"""In place of an index: every entry."""

_KEY: Final = re.compile(r"(?:^|\.)([A-Za-z_]\w*)|\[(\d{1,6}|\*)\]")


def parse_path(text: str) -> tuple[Step, ...]:
    """Return the steps of a path.

    Raises:
        ValueError: It is not valid.
    """
    steps: list[Step] = []
    at = 0
    while at < len(text):
        found = _KEY.match(text, at)
        if found is None:
            break
        key, index = found.groups()
        steps.append(key if key is not None else EACH if index == "*" else int(index))
        at = found.end()
    if at < len(text) or not steps or not isinstance(steps[0], str):
        raise ValueError("allowed: a path such as loss.frame or traffic[*].every_s")
    return tuple(steps)


def put(tree: Any, steps: tuple[Step, ...], value: object) -> None:  # noqa: ANN401 (of JSON)
    """Set the value at a path.

    Args:
        tree: Plain objects, changed in place.
        steps: The path, at least one step.
        value: The new value.

    Raises:
        ValueError: The path does not exist; names the place and the value there.
    """
    _put(tree, steps, 0, value)


def _put(tree: Any, steps: tuple[Step, ...], at: int, value: object) -> None:  # noqa: ANN401
    step, is_last = steps[at], at + 1 == len(steps)
    if isinstance(step, str):
        if not isinstance(tree, dict):
            raise ValueError(
                f"{written(steps[:at]) or 'the file'} is no object; allowed: a path into the file"
            )
        if is_last:
            tree[step] = value
        else:
            follows = steps[at + 1]
            _put(
                tree.setdefault(step, {} if isinstance(follows, str) else []), steps, at + 1, value
            )
        return
    if not isinstance(tree, list):
        raise ValueError(f"{written(steps[:at])} is no array; allowed: a path into the file")
    if not tree or step >= len(tree):
        allowed = f"[0] to [{len(tree) - 1}], or [*]" if tree else "none, it is empty"
        raise ValueError(f"{written(steps[: at + 1])} is not there; allowed: {allowed}")
    for index in range(len(tree)) if step == EACH else (step,):
        if is_last:
            tree[index] = value
        else:
            _put(tree[index], steps, at + 1, value)


def written(steps: tuple[Step, ...]) -> str:
    """Return a path as its text."""
    text = ""
    for step in steps:
        if isinstance(step, str):
            text += f".{step}" if text else step
        else:
            text += "[*]" if step == EACH else f"[{step}]"
    return text
