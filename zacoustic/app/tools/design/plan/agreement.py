"""The cost of agreement on tables with each policy, and the proposed policy.

Both are modelled from a cold start, when the confirmations occur: one per pair of nodes. The policy
with fewer bytes in the first hour is proposed.
"""

from typing import Final

import msgspec

from zacoustic.app.tools.design.plan.fleet import Fleet
from zacoustic.app.tools.design.plan.verdict import MOST_TRIED_ARRIVALS, walk
from zacoustic.core.peers.agreementpolicy import AgreementMethod

COMPARED_S: Final = 3600.0
"""Compared time, s."""


class AgreementPlan(msgspec.Struct, frozen=True, kw_only=True):
    """The cost of agreement."""

    method: str
    """Policy of the file."""
    proposed: str
    """Policy with fewer bytes."""
    share: dict[str, float]
    """Its share of all bytes in `compared_s` after a start, 0…1, by method."""
    compared_s: dict[str, float]
    """Modelled time, s, by method: at most the first hour."""


def agreement_of(fleet: Fleet, seed: int) -> AgreementPlan | None:
    """Compare the policies; None for a single node.

    Args:
        fleet: The fleet.
        seed: Seed of all draws, from 1.
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
