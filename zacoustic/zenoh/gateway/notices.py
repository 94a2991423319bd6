"""Notices of a running gateway: one record per fact, as text or as JSON."""

from collections.abc import Callable

import msgspec


class Notice(msgspec.Struct, frozen=True, kw_only=True, tag_field="event"):
    """A fact; in JSON `event` names it."""

    @property
    def event(self) -> str:
        """Which fact: the word that JSON has."""
        return str(self.__struct_config__.tag)

    @property
    def is_trouble(self) -> bool:
        """Somebody should look at it."""
        return False

    def lines(self) -> list[str]:
        """Return it as lines for people."""
        raise NotImplementedError


class Started(Notice, frozen=True, kw_only=True, tag="started"):
    """The gateway runs."""

    address: int
    """Its acoustic address."""
    name: str = ""
    """Its name in `nodes`."""
    mode: str
    """Mode of its Zenoh session."""
    zid: str
    """Id of its Zenoh session."""
    endpoints: tuple[str, ...]
    """Where the session listens and what it connects to, by the config."""
    listens_here: bool = False
    """The file has no `listen`: only this computer reaches the session."""
    link: str
    """Locator of the modem."""
    link_state: str
    """State of the link."""
    streams: tuple[str, ...]
    """Names of the streams, by id."""
    digest: str
    """Digest of the stream table, hexadecimal."""
    journal: str = ""
    """File of the journal; empty: nothing survives a restart."""
    forgotten: str = ""
    """What a restart forgets for want of a journal, one line; empty: nothing that matters."""
    metrics: str = ""
    """Where it answers to Prometheus; empty: nowhere."""
    recording: str = ""
    """File into which everything is recorded; empty: nothing is."""
    redundant: tuple[int, ...] = ()
    """Addresses of the other local gateways."""

    def lines(self) -> list[str]:
        """One line per fact."""
        lines = [
            f"address   {self.address} {self.name}".rstrip(),
            f"session   {self.mode} {self.zid}",
            *(f"endpoint  {endpoint}" for endpoint in self.endpoints),
            *["endpoint  only this computer reaches it: no listen in the file"] * self.listens_here,
            f"link      {self.link} ({self.link_state})",
            f"streams   {len(self.streams)}: {', '.join(self.streams)}",
            f"digest    {self.digest}",
        ]
        if self.journal or self.forgotten:
            lines.append(f"journal   {self.journal or self.forgotten}")
        if self.metrics:
            lines.append(f"metrics   {self.metrics}")
        if self.recording:
            lines.append(f"recording {self.recording}")
        return lines + [f"redundant gateway {address}" for address in self.redundant]


class LinkChanged(Notice, frozen=True, kw_only=True, tag="link"):
    """The link went up or down."""

    state: str
    """The new state."""
    detail: str = ""
    """What it waits for."""
    link: str = ""
    """Its name, where there are several."""

    @property
    def is_trouble(self) -> bool:
        """Nothing crosses."""
        return self.state != "up"

    def lines(self) -> list[str]:
        """One line."""
        name = f"{self.link} " if self.link else ""
        return [f"link      {name}{self.state} {self.detail}".rstrip()]


class SilenceJournalled(Notice, frozen=True, kw_only=True, tag="silence"):
    """Transmit silence has begun by command, or has ended."""

    silent: bool
    """Nothing is transmitted now."""
    until_utc: str
    """End as far as it is known; empty: until it is resumed, or no silence."""
    doubt: str = ""
    """Why it may last longer than commanded; empty: it does not."""

    def lines(self) -> list[str]:
        """One line."""
        if not self.silent:
            return ["silence   ended"]
        doubt = f" ({self.doubt})" if self.doubt else ""
        return [f"silence   until {self.until_utc or 'it is resumed'}{doubt}"]


class TopicOverridden(Notice, frozen=True, kw_only=True, tag="overridden"):
    """A command has changed how a topic is sent."""

    stream_id: int
    """The topic's stream."""
    stream: str
    """Its name."""
    on: bool
    """Its samples go."""
    min_interval_s: float
    """Least time between two samples of a key, s."""
    priority: str
    """Zenoh's priority."""
    commanded_by: int
    """Address of the commanding node; 0: the local network."""

    def lines(self) -> list[str]:
        """One line."""
        state = "on" if self.on else "off"
        state += f", every {self.min_interval_s:g} s at most" if self.min_interval_s else ""
        by = f"node {self.commanded_by}" if self.commanded_by else "this local network"
        return [f"tuned     {self.stream_id} ({self.stream}): {state}, {self.priority}, by {by}"]


class JournalChanged(Notice, frozen=True, kw_only=True, tag="journal"):
    """The journal cannot be written, or can be again."""

    failure: str
    """Why it cannot be written; empty: it can."""

    @property
    def is_trouble(self) -> bool:
        """What is reliable waits."""
        return bool(self.failure)

    def lines(self) -> list[str]:
        """One line."""
        if self.failure:
            return [f"journal   fails, what is reliable waits: {self.failure}"]
        return ["journal   can be written again"]


class JournalInDoubt(Notice, frozen=True, kw_only=True, tag="journal_in_doubt"):
    """The journal may lack the last writes."""

    reason: str
    """What was found."""

    @property
    def is_trouble(self) -> bool:
        """What was promised before may be forgotten."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        return [f"journal   in doubt, a new life with what is right in it: {self.reason}"]


class SealBroken(Notice, frozen=True, kw_only=True, tag="seal"):
    """Frames do not open that say they are of a node, or open and cannot be of it."""

    address: int
    """The node."""
    name: str = ""
    """Its name in `nodes`."""
    refusal: str
    """``forged``, ``unsealed``, ``former_life``, ``clone`` or ``forbidden``."""
    frames: int
    """How many since the start."""
    is_too_many: bool
    """So many that the key is to be rotated."""
    stream: str = ""
    """Name of the stream that is forbidden to it, or empty."""

    @property
    def is_trouble(self) -> bool:
        """Always."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        text = {
            "unsealed": "its frames are not sealed",
            "forged": "its frames do not open: another key, or not from it",
            "former_life": "it speaks as in a former life: old records, or a recording of it",
            "clone": "another computer has this key and address; nothing is transmitted any more",
            "forbidden": f"it may not say what it says: {self.stream}",
        }[self.refusal]
        rotate = "; rotate the key" if self.is_too_many else ""
        node = f"{self.address} {self.name}".rstrip()
        return [f"seal      {node}: {text} ({self.frames}){rotate}"]


class ClockChanged(Notice, frozen=True, kw_only=True, tag="clock"):
    """Nothing is transmitted for want of a time that is sure; or no longer."""

    doubt: str
    """What is missing; empty: nothing."""

    @property
    def is_trouble(self) -> bool:
        """Nothing is transmitted."""
        return bool(self.doubt)

    def lines(self) -> list[str]:
        """One line."""
        return [
            f"clock     nothing is transmitted: {self.doubt}" if self.doubt else "clock     sure"
        ]


class EngineLost(Notice, frozen=True, kw_only=True, tag="internal_error"):
    """A bug has ended the engine; a new one goes on from the journal."""

    faults: int
    """How many internal errors there were since the start."""
    cause: str
    """What was raised."""

    @property
    def is_trouble(self) -> bool:
        """Report it; the log has what to report."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        return [f"internal  error {self.faults}, please report the log; it goes on: {self.cause}"]


class LinkUnheard(Notice, frozen=True, kw_only=True, tag="unheard"):
    """Frames were sent since the link is up, and nothing at all was heard."""

    frames: int
    """How many were sent."""

    @property
    def is_trouble(self) -> bool:
        """Always."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        return [f"unheard   {self.frames} frames sent and none heard; ask zacoustic doctor"]


class PeerHeard(Notice, frozen=True, kw_only=True, tag="peer"):
    """A node was heard for the first time, or has restarted."""

    address: int
    """The node."""
    name: str = ""
    """Its name in `nodes`."""
    epoch: int
    """Its boot epoch."""
    same_table: bool
    """Its stream table is ours."""
    wire_version: int
    """Its wire version."""

    @property
    def is_trouble(self) -> bool:
        """Not everything may cross."""
        return not self.same_table

    def lines(self) -> list[str]:
        """One line."""
        table = "the same table" if self.same_table else "another table"
        return [f"peer      {self.address} {self.name} with {table}, epoch {self.epoch}"]


class PeerMissed(Notice, frozen=True, kw_only=True, tag="lost"):
    """Nothing was heard of a node for the file's `lost_after_s`."""

    address: int
    """The node."""
    name: str = ""
    """Its name in `nodes`."""

    @property
    def is_trouble(self) -> bool:
        """Always."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        return [f"lost      {self.address} {self.name}: nothing is heard of it".replace(" :", ":")]


class PeerBack(Notice, frozen=True, kw_only=True, tag="found"):
    """A node that was lost is heard again."""

    address: int
    """The node."""
    name: str = ""
    """Its name in `nodes`."""

    def lines(self) -> list[str]:
        """One line."""
        return [f"found     {self.address} {self.name}".rstrip()]


class Subscribed(Notice, frozen=True, kw_only=True, tag="subscribers"):
    """Others subscribe to an on-demand topic of this node than before."""

    stream: str
    """Name of the topic."""
    subscribers: tuple[int, ...]
    """Addresses of the subscribers."""

    def lines(self) -> list[str]:
        """One line."""
        who = ", ".join(map(str, self.subscribers)) or "nobody"
        return [f"wanted    {self.stream} by {who}"]


class SampleLate(Notice, frozen=True, kw_only=True, tag="late"):
    """Of a topic with a deadline no sample came in time, for the first time since the last one."""

    stream: str
    """The key."""
    address: int
    """The node that publishes it."""
    side: str
    """``offered``: not published here; ``requested``: not received here."""
    missed: int
    """How often that has happened in all."""

    @property
    def is_trouble(self) -> bool:
        """Always."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        what = "not published" if self.side == "offered" else "nothing has come"
        return [f"late      {self.stream} of node {self.address}: {what} in time ({self.missed})"]


class StreamDiffers(Notice, frozen=True, kw_only=True, tag="differs"):
    """A node defines a stream in another way; it is stopped between the two."""

    address: int
    """The node."""
    stream_id: int
    """The stream."""
    stream: str = ""
    """Its name here; empty: only the other one has it."""

    @property
    def is_trouble(self) -> bool:
        """Always."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        what = self.stream or "a stream that is not in this file"
        return [f"differs   {self.stream_id} ({what}) at node {self.address}: stopped"]


class RangingFailed(Notice, frozen=True, kw_only=True, tag="ranging"):
    """A range that the file asks for cannot be measured."""

    address: int
    """The node that is far away."""
    text: str
    """Why, one line."""

    @property
    def is_trouble(self) -> bool:
        """Always."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        return [f"ranging   node {self.address}: {self.text}"]


class RedundancyChanged(Notice, frozen=True, kw_only=True, tag="redundant"):
    """The local gateways have changed."""

    addresses: tuple[int, ...]
    """Those alive, this one included."""

    def lines(self) -> list[str]:
        """One line."""
        return [f"redundant gateways on this network: {', '.join(map(str, self.addresses))}"]


class RouterChanged(Notice, frozen=True, kw_only=True, tag="router"):
    """The Zenoh router that the gateway is a client of was lost, or is back."""

    state: str
    """``lost`` or ``back``."""

    @property
    def is_trouble(self) -> bool:
        """The local network is not reached."""
        return self.state == "lost"

    def lines(self) -> list[str]:
        """One line."""
        return [f"router    {self.state}"]


class EntityHeard(Notice, frozen=True, kw_only=True, tag="entity"):
    """A node of rmw_desert has announced an endpoint, or withdrawn it."""

    node: str
    """Namespace and name of the node."""
    kind: str
    """``publisher``, ``subscription``, ``client`` or ``service``."""
    topic: str
    """Topic or service; empty when it leaves."""
    type: str
    """Its type; empty when it leaves."""
    leaves: bool = False
    """It is there no more."""

    def lines(self) -> list[str]:
        """One line."""
        what = "leaves" if self.leaves else f"{self.topic} {self.type}"
        return [f"entity    {self.node}: {self.kind} {what}"]


class NotRecorded(Notice, frozen=True, kw_only=True, tag="recording"):
    """The recording has ended, or something of it was dropped; the gateway goes on."""

    detail: str
    """The file, and why."""

    def lines(self) -> list[str]:
        """One line."""
        return [f"recording {self.detail}"]


class Stopped(Notice, frozen=True, kw_only=True, tag="stopped"):
    """The gateway has ended."""

    def lines(self) -> list[str]:
        """One line."""
        return ["stopped"]


Notify = Callable[[Notice], None]
"""Takes notices, on the loop."""
