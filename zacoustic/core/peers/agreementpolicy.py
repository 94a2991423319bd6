"""How a fleet agrees on its tables: which frames say whose they are, and who answers to that.

What a receiver may decode does not depend on it (`zacoustic.core.peers.handshake`), so nodes with
different policies understand each other: whoever marks more of its frames than it must is always
readable, and whoever answers less is marked for.

=========  =============================================  ==========================================
policy     frames for all                                 good for
=========  =============================================  ==========================================
`CONFIRM`  bare when each node has confirmed, with one    few nodes: zero bytes a frame, for one
           CONFIRM per pair and life                      CONFIRM per pair and life
`TAG`      always marked; nobody confirms, and what is    many nodes: 3.4 bytes a frame, and nothing
           asked and answered is for all who hear it      that grows with the square of the nodes
`SEALED`   bare, with a HELLO in one of sixteen; nobody   fleets with a key: which life and which
           confirms                                       table a frame is of is said by its seal
=========  =============================================  ==========================================

Unsealed frames for one node are the same with both: of those pairs there are as many as have
something for each other, and a confirmation rides on what goes there anyway.
"""

import enum
from collections.abc import Mapping
from typing import Final, Protocol

HELLO_EVERY: Final = 8
"""On broadcast one marked frame of this many carries a HELLO: one byte a frame, on average."""
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
    """What those that a frame is for know of this node."""

    AGREED = enum.auto()
    """All have confirmed its present boot epoch."""
    TOLD = enum.auto()
    """Those that have not know its table, so another HELLO changes nothing."""
    UNKNOWN = enum.auto()
    """Somebody may still need a HELLO, or nobody knows who hears the frame."""


class Opening(enum.Enum):
    """What a frame begins with."""

    BARE = enum.auto()
    """Nothing."""
    TAG = enum.auto()
    """A TAG."""
    HELLO_IF_IT_FITS = enum.auto()
    """A HELLO, or a TAG where that leaves no room for the first record."""
    HELLO = enum.auto()
    """A HELLO; a record that has no room beside it goes in the next frame, unless it is urgent."""


class AgreementPolicy(Protocol):
    """What `Introductions` and `Handshake` ask."""

    @property
    def is_sealed(self) -> bool:
        """Which life and which table a frame is of is said by its seal."""

    @property
    def speaks_to_all(self) -> bool:
        """What a broadcast frame gives cause to say is told to all, without haste.

        Questions, their answers and rows go in broadcast frames then, so a question of another node
        is not asked a second time, and a row that differs is not answered by everybody's own. Who
        hears that a node has restarted says HELLO with the next one.
        """

    def opening(self, *, to_all: bool, hearers: Hearers, since_hello: int, hellos: int) -> Opening:
        """Return what a frame begins with.

        Args:
            to_all: It is a broadcast frame.
            hearers: What those that it is for know.
            since_hello: Marked frames to this destination since the last HELLO, that included; 0
                before the first one.
            hellos: Frames of this boot epoch to this destination that had a HELLO.
        """

    def answers(self, *, unicast: bool) -> bool:
        """Tell whether a HELLO or TAG is answered by CONFIRM, or by HELLO where tables differ."""

    def asks(self, marked: int, *, unicast: bool) -> bool:
        """Tell whether a HELLO that was missed is asked for.

        Args:
            marked: Frames heard with a TAG of that boot epoch, 1 or more.
            unicast: The last of them is for this node alone.
        """

    def longest_pause_units(self, nodes: int) -> int:
        """Return within how many units what is told to all gets a frame of its own.

        Args:
            nodes: How many the table lists.
        """


class Confirming:
    """`AgreementMethod.CONFIRM`: all who hear a broadcast confirm it, each to each."""

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
        """See `AgreementPolicy`: whoever says who it is waits for the answer of each."""
        return True

    def asks(self, marked: int, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: at once, since until all have confirmed all is marked."""
        return True

    def longest_pause_units(self, nodes: int) -> int:
        """See `AgreementPolicy`: few nodes do not crowd."""
        return _SHORT_PAUSE_UNITS


class Tagging:
    """`AgreementMethod.TAG`: broadcasts say whose they are, always, and nobody confirms them.

    A life begins with HELLO, TAG, HELLO, so that few miss both. After a third one in its seventh
    frame there is one in sixteen, and in the next frame after another node has restarted. Whoever
    has heard sixteen frames without one has missed one, and asks; once, since the next one comes by
    itself.
    """

    is_sealed: Final = False
    speaks_to_all: Final = True

    def opening(self, *, to_all: bool, hearers: Hearers, since_hello: int, hellos: int) -> Opening:
        """See `AgreementPolicy`: broadcasts are marked, agreed or not."""
        if not to_all:
            return CONFIRMING.opening(
                to_all=to_all, hearers=hearers, since_hello=since_hello, hellos=hellos
            )
        gap = _FIRST_HELLO_GAPS[hellos] if hellos < len(_FIRST_HELLO_GAPS) else _HELLO_GAP
        return Opening.HELLO if since_hello >= gap else Opening.TAG

    def answers(self, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: what is for all is marked whatever is answered."""
        return unicast

    def asks(self, marked: int, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: once, when it is known to be missed."""
        return unicast or marked == _ASK_AFTER

    def longest_pause_units(self, nodes: int) -> int:
        """See `AgreementPolicy`: all who have missed something may want to speak at once."""
        return max(_SHORT_PAUSE_UNITS, _PAUSE_UNITS_A_NODE * nodes)


class Sealed:
    """Of a fleet with a key: a HELLO is for those whose table is not known to be the same."""

    is_sealed: Final = True
    speaks_to_all: Final = True

    def opening(self, *, to_all: bool, hearers: Hearers, since_hello: int, hellos: int) -> Opening:
        """See `AgreementPolicy`: the first of a life, and one of sixteen."""
        is_turn = hellos == 0 or since_hello >= _HELLO_GAP
        is_wanted = to_all or hearers is not Hearers.AGREED
        return Opening.HELLO if is_turn and is_wanted else Opening.BARE

    def answers(self, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: there is nothing to answer."""
        return False

    def asks(self, marked: int, *, unicast: bool) -> bool:
        """See `AgreementPolicy`: a TAG says nothing."""
        return False

    def longest_pause_units(self, nodes: int) -> int:
        """See `AgreementPolicy`: all who have missed something may want to speak at once."""
        return max(_SHORT_PAUSE_UNITS, 4 * nodes)


CONFIRMING: Final = Confirming()
SEALED: Final = Sealed()
POLICIES: Final[Mapping[AgreementMethod, AgreementPolicy]] = {
    AgreementMethod.CONFIRM: CONFIRMING,
    AgreementMethod.TAG: Tagging(),
}
"""They have no state."""
