"""The traffic that was seen, as a scenario: what `zacoustic config plan` and `sim` reckon with.

The file of a fleet says how often a topic may cross, not how often somebody speaks. For commands
nothing else says it: they have no interval.
"""

import json
from collections.abc import Iterator, Sequence
from typing import Any, Final

from zacoustic.app.tools.design.first.drafting import TopicDraft
from zacoustic.app.tools.design.first.writing import Files, Side
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.config.json5 import parse_json5
from zacoustic.text.safetext import json_line

APART_M: Final = 1000
"""Distance of the two sides, as a plan of a file alone has it, m."""


def write_traffic(
    files: Files,
    *,
    here: Side,
    there: Side,
    others: Sequence[Side] = (),
    config: str,
    profile: str,
) -> str:
    """Write a scenario with the traffic that was seen.

    Args:
        files: What was written of the same survey.
        here: The side that was listened to.
        there: The other side.
        others: Further nodes of the fleet.
        config: Path of its file, as the scenario names it.
        profile: The modem.
    """
    text = "\n".join(_lines(files, here, there, others, config, profile)) + "\n"
    whole: Any = parse_json5(text, source="the scenario")
    scenario_from_mapping(whole, source="the scenario")
    return text


def _lines(
    files: Files, here: Side, there: Side, others: Sequence[Side], config: str, profile: str
) -> Iterator[str]:
    yield "// What zacoustic config init has seen, for `zacoustic config plan` and `zacoustic sim`."
    yield "{"
    yield f"  config: {json_line(config)}, profile: {json_line(profile)},"
    yield '  channel: "none", // EDIT: "sea" has noise and losses'
    yield "  nodes: ["
    for place_m, side in enumerate(sorted([here, there, *others], key=lambda each: each.address)):
        place = f"position: [{place_m * APART_M}, 0, 10]"
        yield f"    {{ address: {side.address}, name: {json_line(side.name)}, {place} }},"
    yield "  ],"
    yield "  traffic: ["
    for draft, example in zip(files.drafts, files.examples, strict=True):
        side = there if draft.is_from_peer else here
        said, fault = _said(draft, example)
        who = f"node: {side.address}, topic: {json_line(draft.name.lstrip('/'))}"
        yield f"    {f'// {fault}: ' if fault else ''}{{ {who}, {said} }},"
    yield "  ],"
    yield "}"


def _said(draft: TopicDraft, example: object) -> tuple[str, str]:
    """Return how often somebody speaks and what he says; and why that is not known, or nothing."""
    seen = draft.seen
    if not seen.samples:
        return "every_s: 60, size_bytes: 16", "nobody published it"
    period_s = float(f"{seen.period_s or 1 / seen.rate_hz:.3g}")
    every_s = f"every_s: {period_s:g}, first_s: {round(seen.last_s % period_s, 3):g}"
    if example is None:
        least, most = seen.smallest_bytes, seen.largest_bytes
        return f"{every_s}, size_bytes: {most if least == most else f'[{least}, {most}]'}", ""
    try:
        return f"{every_s}, value: {json.dumps(example, allow_nan=False)}", ""
    except (TypeError, ValueError):
        return f"{every_s}, value: {{}}", "its values have bytes, which no scenario has"
