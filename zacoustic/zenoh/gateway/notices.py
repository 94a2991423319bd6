"""Notices of a running gateway: one record per fact, as text or as JSON."""

from collections.abc import Callable
from typing import Final

import msgspec


class Notice(msgspec.Struct, frozen=True, kw_only=True, tag_field="event"):
    """A notice; in JSON, `event` names its kind."""

    @property
    def event(self) -> str:
        """Kind of the notice: the word in JSON."""
        return str(self.__struct_config__.tag)

    @property
    def is_trouble(self) -> bool:
        """Whether somebody should look at it."""
        return False

    def lines(self) -> list[str]:
        """Return it as lines of text."""
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
    """Endpoints at which the session listens, or to which it connects, by the config."""
    listens_here: bool = False
    """Whether the file has no `listen`, so that only this computer reaches the session."""
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
    """What a restart loses without a journal, one line; empty: nothing important."""
    metrics: str = ""
    """Place at which it answers Prometheus; empty: nowhere."""
    recording: str = ""
    """File of the recording; empty: no recording."""
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
    """The cause that it waits for."""
    link: str = ""
    """Name of the link, if there are several."""

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
    """Whether the node transmits nothing now."""
    until_utc: str
    """End, if known; empty: until `resume`, or no silence."""
    doubt: str = ""
    """Why the silence may last longer than commanded; empty: it does not."""

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
    """Whether its samples are sent."""
    min_interval_s: float
    """Minimum time between two samples of a key, s."""
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
        """Whether reliable traffic waits."""
        return bool(self.failure)

    def lines(self) -> list[str]:
        """One line."""
        if self.failure:
            return [f"journal   fails, what is reliable waits: {self.failure}"]
        return ["journal   can be written again"]


class JournalInDoubt(Notice, frozen=True, kw_only=True, tag="journal_in_doubt"):
    """The journal may lack the last writes."""

    reason: str
    """What the check of the journal found."""

    @property
    def is_trouble(self) -> bool:
        """Always: the node may have forgotten commitments."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        return [
            f"journal   in doubt, a new boot epoch continues with its valid part: {self.reason}"
        ]


class AddressClash(Notice, frozen=True, kw_only=True, tag="address_shared"):
    """Two nodes have one address."""

    address: int
    """The address."""
    name: str
    """Its name in the table."""
    is_own: bool
    """It is the one of this node."""

    @property
    def is_trouble(self) -> bool:
        """Always: each is taken for the other."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        whose = "this one and another" if self.is_own else "two nodes"
        return [
            f"address   {self.address} {self.name}".rstrip()
            + f": {whose} have it; samples of the two mix and get lost: give each its own"
        ]


FORBIDDEN: Final = "it sends what it may not send"
"""Description of an authentic node that sends what the table does not allow."""


class SealBroken(Notice, frozen=True, kw_only=True, tag="seal"):
    """Frames with a node's address do not open, or open and cannot come from it."""

    address: int
    """The node."""
    name: str = ""
    """Its name in `nodes`."""
    refusal: str
    """``forged``, ``unsealed``, ``former_life``, ``clone``, ``forbidden`` or ``costly``."""
    frames: int
    """Number of such frames since the start."""
    is_too_many: bool
    """Whether there are so many that the key should be rotated."""
    stream: str = ""
    """Name of the stream that the node may not use, or empty."""

    @property
    def is_trouble(self) -> bool:
        """Always."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        text = {
            "unsealed": "its frames are not sealed",
            "forged": "its frames do not open: another key, or not from it",
            "former_life": "it transmits with an earlier life: old records, or a recording of it",
            "clone": "another computer has this key and address; nothing is transmitted any more",
            "forbidden": f"{FORBIDDEN}: {self.stream}",
            "costly": "it has spent security.reply_share: answers to it wait",
        }[self.refusal]
        rotate = "; rotate the key" if self.is_too_many else ""
        node = f"{self.address} {self.name}".rstrip()
        return [f"seal      {node}: {text} ({self.frames}){rotate}"]


class ClockChanged(Notice, frozen=True, kw_only=True, tag="clock"):
    """The node transmits nothing because it does not know the time; or it transmits again."""

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


class AccessChanged(Notice, frozen=True, kw_only=True, tag="access"):
    """A schedule does not hold or is not in use; or it is as it should be again."""

    method: str
    """The method in use."""
    why: str
    """Why it is not the schedule, or no slot can be used; empty: neither."""
    faults: tuple[tuple[int, str, float], ...] = ()
    """Where the schedule does not hold: address, word of a `Trouble`, and by how much, s."""

    @property
    def is_trouble(self) -> bool:
        """Whether something is not as the schedule has it."""
        return bool(self.why or self.faults)

    def lines(self) -> list[str]:
        """One line for the method, and one for each node."""
        told = [f"access    {self.method}: {self.why}"] if self.why else []
        told += [
            f"access    node {node} {trouble_text(word, by)}" for node, word, by in self.faults
        ]
        return told or [f"access    {self.method}"]


def trouble_text(word: str, by_s: float) -> str:
    """Return what is wrong between the schedule and a node, in words.

    Args:
        word: Word of a `Trouble`.
        by_s: By how much, s.
    """
    return {
        "outside": f"transmits {by_s:.2f} s outside its slots: its clock is wrong or it has others",
        "far": f"is {by_s:.2f} s farther away than a guard: the own slot is used that much less",
        "shared": "owns a slot of this node and is heard: they use it in turns",
    }[word]


class EngineLost(Notice, frozen=True, kw_only=True, tag="internal_error"):
    """A bug has ended the engine; a new one continues from the journal."""

    faults: int
    """Number of internal errors since the start."""
    cause: str
    """The exception."""

    @property
    def is_trouble(self) -> bool:
        """Always: report it, with the log."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        return [f"internal  error {self.faults}, please report the log; it goes on: {self.cause}"]


class LinkUnheard(Notice, frozen=True, kw_only=True, tag="unheard"):
    """The node has sent frames since the link came up, and heard none."""

    frames: int
    """Number of frames sent."""

    @property
    def is_trouble(self) -> bool:
        """Always."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        return [f"unheard   {self.frames} frames sent and none heard; ask zacoustic config doctor"]


class BulkRerouted(Notice, frozen=True, kw_only=True, tag="bulk"):
    """Large samples to a node go another way from now on."""

    address: int
    """Its address."""
    name: str
    """Its name, or empty."""
    works: bool
    """Whether they go by the modem's service for much data; else by the one for short frames."""

    @property
    def is_trouble(self) -> bool:
        """If it does not work."""
        return not self.works

    def lines(self) -> list[str]:
        """One line."""
        node = f"{self.name} ({self.address})" if self.name else str(self.address)
        if self.works:
            return [f"bulk      large samples to {node} go fast again"]
        return [f"bulk      fast data do not get through to {node}; large samples go slowly"]


class PeerHeard(Notice, frozen=True, kw_only=True, tag="peer"):
    """A node was heard for the first time, or has restarted."""

    address: int
    """The node."""
    name: str = ""
    """Its name in `nodes`."""
    epoch: int
    """Its boot epoch."""
    same_table: bool
    """It has the same stream table as this node."""
    wire_version: int
    """Its wire version."""

    @property
    def is_trouble(self) -> bool:
        """Whether some streams may not cross."""
        return not self.same_table

    def lines(self) -> list[str]:
        """One line."""
        table = "the same table" if self.same_table else "another table"
        return [f"peer      {self.address} {self.name} with {table}, epoch {self.epoch}"]


class PeerMissed(Notice, frozen=True, kw_only=True, tag="lost"):
    """No frame of a node came for the `lost_after_s` of the file."""

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
        return [f"lost      {self.address} {self.name}: not heard any more".replace(" :", ":")]


class PeerBack(Notice, frozen=True, kw_only=True, tag="found"):
    """A node that was lost is heard again."""

    address: int
    """The node."""
    name: str = ""
    """Its name in `nodes`."""

    def lines(self) -> list[str]:
        """One line."""
        return [f"found     {self.address} {self.name}".rstrip()]


class ReachChanged(Notice, frozen=True, kw_only=True, tag="reach"):
    """A link of a list of links reaches a node, does not any more, or is in doubt."""

    address: int
    """The node."""
    name: str = ""
    """Its name in `nodes`."""
    link: str
    """The link."""
    bond: str
    """The list of links."""
    reach: str
    """`up`, `doubt` or `down`."""

    def lines(self) -> list[str]:
        """One line."""
        node = f"{self.address} {self.name}".rstrip()
        return [f"reach     {node} by {self.link}: {self.reach}"]


class CustodyNotice(Notice, frozen=True, kw_only=True, tag="custody"):
    """A custodian has taken a sample of this node along, or has no room for it."""

    stream: str
    """The carried topic."""
    subscriber: int
    """The node that it is for."""
    custodian: int | None
    """The node that has it; None: none has it any more."""
    detail: str
    """Why none has it."""

    @property
    def is_trouble(self) -> bool:
        """Whether nobody takes it along."""
        return self.custodian is None

    def lines(self) -> list[str]:
        """One line."""
        what = self.detail if self.custodian is None else f"in custody of {self.custodian}"
        return [f"custody   {self.stream} for {self.subscriber}: {what}"]


class LostContactNotice(Notice, frozen=True, kw_only=True, tag="lost_contact"):
    """An entry of `lost_contact`: contact is lost, the action fails or is done, contact is back."""

    name: str
    """Name of the entry."""
    state: str
    """`lost`, `unanswered`, `acted` or `restored`."""
    detail: str
    """What is done, and how it went, one line."""

    @property
    def is_trouble(self) -> bool:
        """Whether contact is lost."""
        return self.state != "restored"

    def lines(self) -> list[str]:
        """One line."""
        return [f"contact   {self.name} {self.state}: {self.detail}"]


class Subscribed(Notice, frozen=True, kw_only=True, tag="subscribers"):
    """The subscribers of an on-demand topic of this node have changed."""

    stream: str
    """Name of the topic."""
    subscribers: tuple[int, ...]
    """Addresses of the subscribers."""

    def lines(self) -> list[str]:
        """One line."""
        who = ", ".join(map(str, self.subscribers)) or "nobody"
        return [f"wanted    {self.stream} by {who}"]


class SampleLate(Notice, frozen=True, kw_only=True, tag="late"):
    """A topic with a deadline had no sample in time, for the first time since the last sample."""

    stream: str
    """The key."""
    address: int
    """The node that publishes it."""
    side: str
    """``offered``: not published here; ``requested``: not received here."""
    missed: int
    """Total number of missed deadlines."""

    @property
    def is_trouble(self) -> bool:
        """Always."""
        return True

    def lines(self) -> list[str]:
        """One line."""
        what = "not published" if self.side == "offered" else "nothing has come"
        return [f"late      {self.stream} of node {self.address}: {what} in time ({self.missed})"]


class StreamDiffers(Notice, frozen=True, kw_only=True, tag="differs"):
    """A node defines a stream differently; the stream stops between the two."""

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
    """A range that the file requests cannot be measured."""

    address: int
    """The other node."""
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
    """Addresses of the live gateways, this one included."""

    def lines(self) -> list[str]:
        """One line."""
        return [f"redundant gateways on this network: {', '.join(map(str, self.addresses))}"]


class RouterChanged(Notice, frozen=True, kw_only=True, tag="router"):
    """The gateway, as a client, has lost its Zenoh router, or has it back."""

    state: str
    """``lost`` or ``back``."""

    @property
    def is_trouble(self) -> bool:
        """The local network cannot be reached."""
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
    """Whether the endpoint was withdrawn."""

    def lines(self) -> list[str]:
        """One line."""
        what = "leaves" if self.leaves else f"{self.topic} {self.type}"
        return [f"entity    {self.node}: {self.kind} {what}"]


class NotRecorded(Notice, frozen=True, kw_only=True, tag="recording"):
    """The recording has ended, or has dropped something; the gateway goes on."""

    detail: str
    """The file and the reason."""

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
