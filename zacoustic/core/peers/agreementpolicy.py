"""How a fleet agrees on its tables: which frames identify their sender, and who answers.

The policy does not change what a receiver may decode (`zacoustic.core.peers.handshake`), so nodes
with different policies understand each other: marks that were not needed do no harm, and a node
that answers less gets marked frames.

=========  =============================================  ==========================================
policy     frames for all                                 good for
=========  =============================================  ==========================================
`CONFIRM`  bare when each node has confirmed, with one    few nodes: zero bytes a frame, for one
           CONFIRM per pair and boot epoch                CONFIRM per pair and boot epoch
`TAG`      always marked; nobody confirms; questions and  many nodes: 3.4 bytes a frame, and nothing
           answers go to all                              that grows with the square of the nodes
`SEALED`   bare, with a HELLO in one of sixteen; nobody   fleets with a key: the seal identifies the
           confirms                                       boot epoch and the table of a frame
=========  =============================================  ==========================================

With `CONFIRM` and `TAG`, unsealed frames for one node are the same: only pairs that exchange data
have to agree, and a confirmation rides on that data.
"""

import enum
from collections.abc import Mapping
from typing import Final, Protocol

TAGS_FROM_NODES: Final = 6
"""From so many nodes on, `TAG` takes fewer bytes and less than half of the frames of `CONFIRM`, and
more arrives: a report to all every five minutes, in the first hour (`bench_fleets.py`)."""
HELLO_EVERY: Final = 8
"""One of this many marked broadcast frames carries a HELLO: one byte a frame, on average."""
_FIRST_HELLO_GAPS: Final = (0, 2, 4)
_HELLO_GAP: Final = 16
_ASK_AFTER: Final = _HELLO_GAP
_SHORT_PAUSE_UNITS: Final = 2
_PAUSE_UNITS_A_NODE: Final = 4


class AgreementMethod(enum.Enum):
    """The policies by their words in the configuration."""

    CONFIRM = "confirm"
    TAG = "tag"


class Hearers(enum.Enum):
    """What the receivers of a frame know of this node."""

    AGREED = enum.auto()
    """All have confirmed its current boot epoch."""
    TOLD = enum.auto()
    """Those that have not confirmed know its table, so another HELLO changes nothing."""
    UNKNOWN = enum.auto()
    """Somebody may still need a HELLO, or nobody knows who hears the frame."""


class Opening(enum.Enum):
    """How a frame begins."""

    BARE = enum.auto()
    """Nothing."""
    TAG = enum.auto()
    """A TAG."""
    HELLO_IF_IT_FITS = enum.auto()
    """A HELLO, or a TAG if a HELLO leaves no room for the first record."""
    HELLO = enum.auto()
    """A HELLO; a record without room beside it goes in the next frame, unless it is urgent."""


class AgreementPolicy(Protocol):
    """What `Introductions` and `Handshake` ask."""

    @property
    def is_sealed(self) -> bool:
        """The seal identifies the boot epoch and the table of a frame."""

    @property
    def speaks_to_all(self) -> bool:
        """Reactions to a broadcast frame go to all, without haste.

        Questions, answers and rows then go in broadcast frames. So one question serves all nodes,
        and a row that differs does not make every node answer with its own. A node that hears of a
        restart says HELLO in its next broadcast frame.
        """

    def opening(self, *, to_all: bool, hearers: Hearers, since_hello: int, hellos: int) -> Opening:
        """Return how a frame begins.

        Args:
            to_all: It is a broadcast frame.
            hearers: What its receivers know.
            since_hello: Marked frames to this destination since the last HELLO, including that
                frame; 0 before the first one.
            hellos: Frames of this boot epoch to this destination that had a HELLO.
        """

    def answers(self, *, unicast: bool) -> bool:
        """Return whether a HELLO or TAG gets a CONFIRM, or a HELLO if the tables differ."""

    def asks(self, marked: int, *, unicast: bool) -> bool:
        """Return whether to ask for a missed HELLO.

        Args:
            marked: Frames with a TAG of that boot epoch heard so far, 1 or more.
            unicast: The last of them is for this node alone.
        """

    def longest_pause_units(self, nodes: int) -> int:
        """Return the time, units, within which statements for all get a frame of their own.

        Args:
            nodes: Length of the table's list of nodes.
        """


class Confirming:
    """`AgreementMethod.CONFIRM`: each node that hears a broadcast confirms it to its sender."""

    is_sealed: Final = False
    speaks_to_all: Final = False

    def opening(self, *, to_all: bool, hearers: Hearers, since_hello: int, hellos: int) -> Opening:
        """See `AgreementPolicy`: marked until all have confirmed."""
        if hearers is not Hearers.UNKNOWN:
            return Opening.BARE if hearers is Hearers.AGREED else Opening.TAG
        if since_hello % HELLO_EVERY == 0:
            return Opening.HELLO
        return Opening.TAG if to_all else Opening.HELLO_IF_IT_FITS

    def answers(self, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: a node that introduces itself waits for each answer."""
        return True

    def asks(self, marked: int, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: at once, since all frames are marked until all have confirmed."""
        return True

    def longest_pause_units(self, nodes: int) -> int:
        """See `AgreementPolicy`: few nodes do not crowd."""
        return _SHORT_PAUSE_UNITS


class Tagging:
    """`AgreementMethod.TAG`: broadcasts always identify their sender, and nobody confirms them.

    A boot epoch begins with HELLO, TAG, HELLO, so that few nodes miss both. A third HELLO is in the
    seventh frame, then one in every sixteenth, and one in the next frame after another node has
    restarted. A node that hears sixteen frames without a HELLO has missed one. It asks once, since
    the next HELLO comes by itself.
    """

    is_sealed: Final = False
    speaks_to_all: Final = True

    def opening(self, *, to_all: bool, hearers: Hearers, since_hello: int, hellos: int) -> Opening:
        """See `AgreementPolicy`: broadcasts are always marked."""
        if not to_all:
            return CONFIRMING.opening(
                to_all=to_all, hearers=hearers, since_hello=since_hello, hellos=hellos
            )
        gap = _FIRST_HELLO_GAPS[hellos] if hellos < len(_FIRST_HELLO_GAPS) else _HELLO_GAP
        return Opening.HELLO if since_hello >= gap else Opening.TAG

    def answers(self, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: an answer would not change that broadcasts are marked."""
        return unicast

    def asks(self, marked: int, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: once, when a HELLO was certainly missed."""
        return unicast or marked == _ASK_AFTER

    def longest_pause_units(self, nodes: int) -> int:
        """See `AgreementPolicy`: all nodes that missed something may want to speak at once."""
        return max(_SHORT_PAUSE_UNITS, _PAUSE_UNITS_A_NODE * nodes)


class Sealed:
    """Of a fleet with a key: a HELLO is for nodes that may have another table."""

    is_sealed: Final = True
    speaks_to_all: Final = True

    def opening(self, *, to_all: bool, hearers: Hearers, since_hello: int, hellos: int) -> Opening:
        """See `AgreementPolicy`: in the first frame of a boot epoch, and in one of sixteen."""
        is_turn = hellos == 0 or since_hello >= _HELLO_GAP
        is_wanted = to_all or hearers is not Hearers.AGREED
        return Opening.HELLO if is_turn and is_wanted else Opening.BARE

    def answers(self, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: there is nothing to answer."""
        return False

    def asks(self, marked: int, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: sealed frames have no TAG."""
        return False

    def longest_pause_units(self, nodes: int) -> int:
        """See `AgreementPolicy`: all nodes that missed something may want to speak at once."""
        return max(_SHORT_PAUSE_UNITS, 4 * nodes)


CONFIRMING: Final = Confirming()
SEALED: Final = Sealed()
POLICIES: Final[Mapping[AgreementMethod, AgreementPolicy]] = {
    AgreementMethod.CONFIRM: CONFIRMING,
    AgreementMethod.TAG: Tagging(),
}
"""One object each: they have no state."""
