"""The link contract: the methods that a modem driver implements, and those that it may call.

A link turns a `Transmission` into sound and sound into a `ReceivedFrame`; it knows its device and
nothing about streams. The conformance battery (`zacoustic.testing.conformance`) proves these rules:

- Everything runs on one asyncio loop. A link calls the receiver only on that loop, and never from
  `transmit` itself.
- `transmit` returns at once. At most one transmission is outstanding. Exactly one `TransmitReport`
  follows each, also if the frame is empty, above the MTU, or comes while another one is outstanding
  (REJECTED, with the reason in `detail`), or if the link is lost or closed meanwhile (ABORTED).
- A link with a *bulk service* (`LinkCapabilities.bulk`) takes beside that transmission several of
  that service, up to its `most_outstanding`, and reports each by its id in whatever order. It keeps
  them in its device as far as there is room, so that the device never waits for the next one.
- `capabilities` are set before `state_changed(UP)`, and may differ at a later UP.
- A link reports a lost device as DOWN first, then outstanding transmissions as ABORTED.
- A link reconnects by itself and reports it (`LinkState`); it queues no frames but
  those of a bulk service.
- After `close` has returned, a link calls nobody; `close` may be called again. A link that was
  closed, or whose `open` has raised, can be opened again: a node with several links does so.
- The link stamps `received_at` where it reads the bytes; it never decreases.
- `measured` reports measurements of the device once they are known. With `measures_range`, they
  include the propagation delay of each transmission that ended DELIVERED, measured in this very
  exchange and not in an earlier one; a link does not report an unknown delay.
- Bytes from the device never raise; the link ignores those that it cannot parse, and counts them in
  `diagnostics`.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import (
    Any,
    ClassVar,
    Final,
    Protocol,
    Self,
)

import msgspec

from zacoustic.core.base.linktypes import (
    LinkCapabilities,
    LinkState,
    Measurement,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.text.allowed import ANY, allowed, check_fields, located, table_of

LINK_API: Final = 1
"""Version of this contract; the registry refuses a link for another version."""


class LinkConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings from the `#key=value&…` part of a locator; each link extends it.

    A setting declares its range at its field, ``Annotated[int, Meta(ge=16, le=64)]``; then the
    locator, programs and errors follow it. A link with checks of its own calls this one first.
    """

    def __post_init__(self) -> None:
        """Check what the fields declare.

        Raises:
            ValueError: A value is not allowed; states key, value and what is allowed.
        """
        check_fields(self)


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """A fault, present or expected at sea; `zacoustic config doctor` collects them."""

    what: str
    """The fault, with values."""
    why: str
    """Its effect at sea."""
    cure: str
    """Its cure."""


class LoggedFrame(msgspec.Struct, frozen=True, kw_only=True):
    """A frame in a log of the bytes to and from a device."""

    frame_bytes: bytes
    """The frame."""
    source: int
    """Address of the source; 0: the log does not have it."""
    destination: int
    """Address of the destination; 255: broadcast."""
    is_sent: bool
    """Whether it went to the device; otherwise it was received."""


class LinkReceiver(Protocol):
    """Receives the reports of a link, only on the loop. The runtime implements it."""

    def frame_received(self, frame: ReceivedFrame) -> None:
        """Take a received frame, or a piece of the byte stream."""
        ...

    def transmit_finished(self, report: TransmitReport) -> None:
        """Take the report of a transmission that has ended."""
        ...

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        """Note that the link went up or down; `detail` says what it waits for."""
        ...

    def carrier_changed(self, busy: bool) -> None:
        """Note that another node's transmission began or ended; only with `senses_carrier`."""
        ...

    def measured(self, measurement: Measurement) -> None:
        """Take values that the device has measured of another modem, or reports of itself."""
        ...


class Link(ABC):
    """One acoustic modem, or something that behaves like one.

    Must implement: `config_type`, `capabilities`, `from_locator`, `open`, `close`, `transmit`. May
    override: `diagnostics`, `examine`, `assess`, `read_log`, which have defaults here.
    """

    link_api: ClassVar[int] = LINK_API
    config_type: ClassVar[type[LinkConfig]] = LinkConfig
    """Record of the settings in the locator."""

    capabilities: LinkCapabilities
    """Capabilities of the link; valid after `open` has returned."""

    @classmethod
    @abstractmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        """Create a link that is not open yet.

        Args:
            address: The part of the locator between `NAME/` and `#`.
            config: The settings after `#`, as `config_type`.
            node_address: Acoustic address of this node, 1…254.

        Raises:
            ConfigError: The address is not valid for this link.
        """

    @abstractmethod
    async def open(self, receiver: LinkReceiver) -> None:
        """Open the device; returns when the link is UP or keeps trying in the background.

        Raises:
            LinkOpenError: The device cannot be opened and waiting will not help, or it has not
                appeared within the time that the settings allow.
        """

    @abstractmethod
    async def close(self) -> None:
        """Release everything, and call nobody afterwards. May be called again."""

    @abstractmethod
    def transmit(self, transmission: Transmission) -> None:
        """Start a transmission without blocking; exactly one report follows.

        Raises:
            LinkClosedError: The link has not been opened, or has been closed.
        """

    def diagnostics(self) -> dict[str, int | float | str]:
        """Return counters and readings of the device for the health report, by name."""
        return {}

    async def examine(self, patience_s: float) -> list[Finding]:
        """Look for faults of the device; for `zacoustic config doctor`, in place of `open`.

        It transmits nothing. No other program has the device. The default opens the link, waits
        until it is UP, and closes it.

        Args:
            patience_s: Time for the device to answer, s.
        """
        watcher = _UpWatcher()
        try:
            async with asyncio.timeout(patience_s):
                await self.open(watcher)
                await watcher.up.wait()
        except (TimeoutError, LinkOpenError) as error:
            said = str(error) or f"not ready after {patience_s:g} s: {watcher.detail}"
            return [
                Finding(
                    what=f"the modem cannot be used: {said}",
                    why="without it this node is deaf and mute",
                    cure=getattr(error, "hint", "") or "see that it is switched on and connected",
                )
            ]
        finally:
            await self.close()
        return []

    def assess(self, health: Mapping[str, Any]) -> list[Finding]:
        """Find faults in a running gateway's health report; the link is not open.

        Args:
            health: The health keys below `@acoustic/ADDRESS/`, by name: `link`, `dropped`, `modem`,
                …
        """
        return []

    @classmethod
    def read_log(cls, log: bytes) -> Iterator[LoggedFrame]:
        """Find the frames in a log of the port of such a device; for `zacoustic decode --log`.

        Args:
            log: The bytes of both directions, perhaps with something else between them.
        """
        return iter(())


class _UpWatcher:
    """Notes only whether a link is UP."""

    def __init__(self) -> None:
        self.up = asyncio.Event()
        self.detail = ""

    def frame_received(self, frame: ReceivedFrame) -> None:
        pass

    def transmit_finished(self, report: TransmitReport) -> None:
        pass

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        self.detail = detail
        if state is LinkState.UP:
            self.up.set()

    def carrier_changed(self, busy: bool) -> None:
        pass

    def measured(self, measurement: Measurement) -> None:
        pass


def convert_config(
    config_type: type[LinkConfig], settings: dict[str, str], *, source: str
) -> LinkConfig:
    """Convert the settings of a locator to the record of its link.

    Args:
        config_type: The link's `config_type`.
        settings: Key and text of each setting.
        source: The locator, for the message.

    Raises:
        ConfigError: A key is unknown, or a value is not allowed; the message names both and the
            allowed values.
    """
    fields = table_of(config_type).fields
    declared = {each.encode_name: each.type for each in fields}
    for name in settings:
        if name not in declared:
            known = ", ".join(declared) or "none"
            raise ConfigError(f"{source}: unknown setting {name!r}; allowed settings: {known}")
    try:
        return msgspec.convert(settings, config_type, strict=False)
    except msgspec.ValidationError as error:
        message, path = located(error)
        name = path.removeprefix(".")
        if name not in declared:
            raise ConfigError(f"{source}: {error}") from error
        words = allowed(declared[name])
        what = f"{name} is {settings[name]!r}; allowed: {message if words == ANY else words}"
        raise ConfigError(f"{source}: {what}") from error
