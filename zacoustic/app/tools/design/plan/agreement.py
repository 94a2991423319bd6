"""What agreement on tables takes with each policy, and which one to choose.

Both are walked from a cold start, since that is when confirmations go: one per pair of nodes. What
takes fewer bytes in the first hour is proposed.
"""

from typing import Final

import msgspec

from zacoustic.app.tools.design.plan.fleet import Fleet
from zacoustic.app.tools.design.plan.verdict import MOST_TRIED_ARRIVALS, walk
from zacoustic.core.peers.agreementpolicy import AgreementMethod

COMPARED_S: Final = 3600.0
"""How long is compared, s."""


class AgreementPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What agreement takes."""

    method: str
    """What the file has."""
    proposed: str
    """What takes fewer bytes."""
    share: dict[str, float]
    """Share of all bytes that it takes in `compared_s` after a start, 0…1, by method."""
    compared_s: dict[str, float]
    """How long was walked, s, by method: at most the first hour."""


def agreement_of(fleet: Fleet, seed: int) -> AgreementPlan | None:
    """Compare the policies; None for a single node.

    Args:
        fleet: The fleet.
        seed: Of the model.
    """
    if len(fleet.tables) < 2:
        return None
    share: dict[str, float] = {}
    compared_s: dict[str, float] = {}
    for method in AgreementMethod:
        rules = {
            address: msgspec.structs.replace(each, agreement=method)
            for address, each in fleet.rules.items()
        }
        found = walk(
            msgspec.structs.replace(fleet, rules=rules), COMPARED_S, seed, MOST_TRIED_ARRIVALS
        )
        share[method.value] = found.agreement_bytes / max(1, found.transmitted_bytes)
        compared_s[method.value] = found.walked_s
    return AgreementPlan(
        method=next(iter(fleet.rules.values())).agreement.value,
        proposed=min(share, key=lambda each: share[each]),
        share=share,
        compared_s=compared_s,
    )
