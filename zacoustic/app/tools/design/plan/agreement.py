"""The cost of agreement on tables with each policy, and the proposed policy.

Both are simulated from a cold start, when the confirmations occur: one per pair of nodes. The
policy with fewer bytes in the first hour is proposed.
"""

import msgspec

from zacoustic.app.tools.design.plan.fleet import Fleet
from zacoustic.app.tools.design.plan.verdict import walk
from zacoustic.app.tools.design.plan.walk import FIRST_ARRIVALS, FIRST_S, Found
from zacoustic.core.peers.agreementpolicy import AgreementMethod


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


def agreement_of(fleet: Fleet, found: Found, seed: int) -> AgreementPlan | None:
    """Compare the policies; None for a single node.

    Args:
        fleet: The fleet.
        found: What came of its own policy.
        seed: Seed of all draws, from 1.
    """
    if len(fleet.tables) < 2:
        return None
    share: dict[str, float] = {}
    compared_s: dict[str, float] = {}
    for method in AgreementMethod:
        each = found
        if any(rules.agreement is not method for rules in fleet.rules.values()):
            other = {
                address: msgspec.structs.replace(rules, agreement=method)
                for address, rules in fleet.rules.items()
            }
            until_s = min(FIRST_S, found.walked_s)
            changed = msgspec.structs.replace(fleet, rules=other)
            each = walk(changed, until_s, seed, FIRST_ARRIVALS)
        share[method.value] = each.first_agreement
        compared_s[method.value] = each.first_s
    return AgreementPlan(
        method=next(iter(fleet.rules.values())).agreement.value,
        proposed=min(share, key=lambda each: share[each]),
        share=share,
        compared_s=compared_s,
    )
