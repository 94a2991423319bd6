"""The first pass over a frame: statements about the sender, and what it knows of this node.

HELLO and TAG give its boot epoch, CONFIRM says that it knows the table of this node, and ASK and
TABLE concern what one of the two does not know. `Handshake` has the rules; this module maps each
control to a rule.
"""

from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.lives import Lives
from zacoustic.core.peers.peers import Peers
from zacoustic.core.peers.reception import Heard, Reception
from zacoustic.core.wire.agreement import WIRE_VERSION, Ask, Confirm, Hello, TableRow, Tag


class Statements:
    """Takes the controls of agreement.

    Args:
        handshake: Gets the statements.
        peers: Signal those that concern other components.
        lives: Learns who has heard this node.
        reception: Dispatches the controls.
    """

    def __init__(
        self, handshake: Handshake, peers: Peers, lives: Lives, reception: Reception
    ) -> None:
        self._handshake = handshake
        self._lives = lives
        self._peers = peers
        reception.of_sender(Ask, self._ask)
        reception.of_sender(TableRow, self._row)
        if handshake.is_sealed:
            reception.of_sender(Hello, self._sealed_hello)
            return
        reception.of_sender(Hello, self._hello)
        reception.of_sender(Tag, self._tag)
        reception.of_sender(Confirm, self._confirm)

    def _hello(self, heard: Heard, hello: Hello) -> str | None:
        self._handshake.heard_hello(heard.source, hello, heard.now, unicast=heard.is_unicast)
        if hello.version != WIRE_VERSION:
            heard.is_foreign = True
            return "version"
        heard.epoch = hello.epoch
        return None

    def _sealed_hello(self, heard: Heard, hello: Hello) -> str | None:
        """Take the digest of the sender's table; the seal already gives the boot epoch."""
        if hello.epoch != heard.epoch or hello.version != WIRE_VERSION:
            return "version"
        self._handshake.authentic(heard.source, hello.epoch, hello.digest, heard.now)
        return None

    def _tag(self, heard: Heard, tag: Tag) -> None:
        self._handshake.heard_tag(heard.source, tag.epoch, heard.now, unicast=heard.is_unicast)
        heard.epoch = heard.tagged = tag.epoch

    def _confirm(self, heard: Heard, confirm: Confirm) -> None:
        source, now, unicast = heard.source, heard.now, heard.is_unicast
        is_ours = self._handshake.confirms_us(confirm, unicast=unicast)
        if is_ours and heard.tagged is not None:
            # A TAG, and the statement that its sender shares our table, together make a HELLO.
            hello = Hello(WIRE_VERSION, heard.tagged, self._handshake.digest)
            self._handshake.heard_hello(source, hello, now, unicast=unicast)
            if unicast:
                self._handshake.heard_introduction(source)
        epoch = self._peers[source].epoch
        if is_ours and epoch is not None:
            self._lives.proved(source, epoch, now + self._handshake.settling_ns)
            self._peers.proved(source, epoch, now)
        self._handshake.heard_confirm(source, confirm, now, unicast=unicast)

    def _ask(self, heard: Heard, ask: Ask) -> None:
        if self._handshake.heard_ask(heard.source, ask, heard.now):
            self._peers.asked(heard.source, heard.now)

    def _row(self, heard: Heard, row: TableRow) -> None:
        self._handshake.heard_row(heard.source, row, heard.now, unicast=heard.is_unicast)
        if self._handshake.differs(heard.source, row.stream_id):
            self._peers.differs(heard.source, row.stream_id, heard.now)
