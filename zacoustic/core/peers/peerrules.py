"""What the config says of how a node treats the others, whatever the link."""

import msgspec

from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.peers.contact import ContactRules


class PeerRules(msgspec.Struct, frozen=True, kw_only=True):
    """How the others are told of this node, and when it misses them."""

    contact: ContactRules = ContactRules()
    """How often the node is to be heard, and when it misses others."""
    agreement: AgreementMethod = AgreementMethod.CONFIRM
    """How much is said and answered to agree on tables."""
