"""Settings of how a node treats the others, on all links."""

import msgspec

from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.peers.contact import ContactRules


class PeerRules(msgspec.Struct, frozen=True, kw_only=True):
    """How the node introduces itself to others, and when it counts one as lost."""

    contact: ContactRules = ContactRules()
    """Heartbeats, and the time after which others are lost."""
    agreement: AgreementMethod = AgreementMethod.CONFIRM
    """Policy of the agreement on tables."""
