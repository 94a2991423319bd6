"""The link contract: what a driver of an acoustic modem implements, and what it may call.

A link turns a `Transmission` into sound and sound into `ReceivedFrame`; it knows its device and
nothing about streams. Rules, all proven by the conformance battery
(`zacoustic.testing.conformance`):

- Everything runs on one asyncio loop. The receiver is called on that loop only, never from
  `transmit` itself.
- `transmit` returns at once. One transmission is outstanding at most. Exactly one `TransmitReport`
  follows each: also for a frame that is empty, above the MTU, or comes while another is outstanding
  (REJECTED, with the reason in `detail`), and when the link is lost or closed meanwhile (ABORTED).
- `capabilities` are set before `state_changed(UP)`, and may be others at a later UP.
- A lost device is reported as DOWN first, then the ABORTED report of what was under way.
- A link reconnects by itself and says so (`LinkState`); it queues no frames of its own.
- After `close` has returned no callback is made; `close` may be called again. A link that was
  closed, or whose `open` has raised, can be opened again: a node does so until each of its further
  links is open.
- `received_at` is stamped where the bytes are read, and never decreases.
- `measured` reports what the device measures, once it is known. With `measures_range`, that
  includes the propagation delay of each transmission that ended DELIVERED, measured in this very
  exchange and not in an earlier one; an unknown delay is not reported.
- Bytes from the device never raise; what cannot be understood is ignored and counted in
  `diagnostics`.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import (
    Any,
    ClassVar,
    Final,
    Literal,
    Protocol,
    Self,
    get_args,
    get_origin,
    get_type_hints,
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

LINK_API: Final = 1
"""Version of this contract; the registry refuses a link that was written for another."""


class LinkConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Settings from the `#key=value&…` part of a locator; each link extends it."""


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """Something that is wrong, or will be at sea; `zacoustic doctor` collects them."""

    what: str
    """What was found, with the values."""
    why: str
    """What it does at sea."""
    cure: str
    """What to do about it."""


class LoggedFrame(msgspec.Struct, frozen=True, kw_only=True):
    """A frame in a log of what went to a device and came from it."""

    frame_bytes: bytes
    """The frame."""
    source: int
    """Its sender; 0: the log does not have it."""
    destination: int
    """Whom it is for; 255: everybody."""
    is_sent: bool
    """It went to the device; otherwise it was received."""


class LinkReceiver(Protocol):
    """Who hears from a link; called on the loop only. The runtime implements it."""

    def frame_received(self, frame: ReceivedFrame) -> None:
        """A frame, or a piece of the byte stream, arrived."""
        ...

    def transmit_finished(self, report: TransmitReport) -> None:
        """A transmission has ended."""
        ...

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        """The link went up or down; `detail` names what it waits for."""
        ...

    def carrier_changed(self, busy: bool) -> None:
        """Somebody else's transmission began or ended; only where `senses_carrier`."""
        ...

    def measured(self, measurement: Measurement) -> None:
        """The device has measured another modem, or reports values of itself."""
        ...


class Link(ABC):
    """One acoustic modem, or something that behaves like one.

    Must implement: `config_type`, `capabilities`, `from_locator`, `open`, `close`, `transmit`.
    May override: `diagnostics`, `examine`, `assess`, `read_log`. Everything else has its default
    here.
    """

    link_api: ClassVar[int] = LINK_API
    config_type: ClassVar[type[LinkConfig]] = LinkConfig
    """What the settings in the locator are converted to."""

    capabilities: LinkCapabilities
    """Valid after `open` has returned."""

    @classmethod
    @abstractmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        """Build a link that is not open yet.

        Args:
            address: The part of the locator between `NAME/` and `#`.
            config: The settings behind `#`, as `config_type`.
            node_address: Acoustic address of this node, 1…254.

        Raises:
            ConfigError: The address cannot be one of this link.
        """

    @abstractmethod
    async def open(self, receiver: LinkReceiver) -> None:
        """Open the device; returns when the link is UP or keeps trying in the background.

        Raises:
            LinkOpenError: The device cannot be opened and waiting will not help, or has not come
                within the time that the link's config allows.
        """

    @abstractmethod
    async def close(self) -> None:
        """Release everything; after it no callback is made. May be called again."""

    @abstractmethod
    def transmit(self, transmission: Transmission) -> None:
        """Start a transmission; does not block; exactly one report follows.

        Raises:
            LinkClosedError: The link has not been opened, or has been closed.
        """

    def diagnostics(self) -> dict[str, int | float | str]:
        """Counters and readings of the device for the health report, by name."""
        return {}

    async def examine(self, patience_s: float) -> list[Finding]:
        """Look for faults of the device; for `zacoustic doctor`, in place of `open`.

        Nothing is transmitted, and no other program has the device. The default opens the
        link, waits until it is UP, and closes it.

        Args:
            patience_s: How long the device may take to answer, s.
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
        """Find faults in a running gateway's health report of its link; not open.

        Args:
            health: The documents below `@acoustic/ADDRESS/`, by name: `link`, `dropped`, `modem`, …
        """
        return []

    @classmethod
    def read_log(cls, log: bytes) -> Iterator[LoggedFrame]:
        """Find the frames in a log of the port of such a device; for `zacoustic decode --log`.

        Args:
            log: Bytes of both directions as they were, perhaps with something in between.
        """
        return iter(())


class _UpWatcher:
    """Hears from a link whether it is UP, and nothing else."""

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
    """Convert the settings of a locator to the config of its link.

    Args:
        config_type: The link's `config_type`.
        settings: Key and text of each setting.
        source: The locator, for the message.

    Raises:
        ConfigError: Unknown key or a value of the wrong kind; names both and the allowed values.
    """
    kinds = get_type_hints(config_type, include_extras=True)
    for name, text in settings.items():
        if name not in config_type.__struct_fields__:
            allowed = ", ".join(config_type.__struct_fields__) or "none"
            raise ConfigError(f"{source}: unknown setting {name!r}; allowed settings: {allowed}")
        try:
            msgspec.convert(text, kinds[name], strict=False)
        except msgspec.ValidationError as error:
            allowed = _allowed_values(kinds[name]) or str(error)
            raise ConfigError(f"{source}: {name} is {text!r}; allowed: {allowed}") from error
    values: dict[str, Any] = dict(settings)
    try:
        return msgspec.convert(values, config_type, strict=False)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{source}: {error}") from error


def _allowed_values(kind: object) -> str:
    """Return in words what a setting of that kind can be; empty if there are no words for it."""
    if get_origin(kind) is Literal:
        return ", ".join(map(str, get_args(kind)))
    members = [each for each in get_args(kind) if each is not type(None)]
    if len(members) == 1:
        return _allowed_values(members[0])
    return {bool: "true, false", int: "a whole number", float: "a number"}.get(kind, "")  # type: ignore[call-overload, no-any-return]
