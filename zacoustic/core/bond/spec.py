"""A bond: a list of links of which each frame takes the first that reaches its receivers."""

import enum
import sys
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import DurationOrZero
from zacoustic.core.wire.relay import LAST_ROUTE
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import check_fields

PROBE_S: Final = 5.0
"""Pause between two questions whether a link reaches anybody again, s."""
DOWN_AFTER_S: Final = 3.0
"""A link that answers is out of use after so long without an answer, s."""
SILENT_AFTER_S: Final = 600.0
"""The same for a link that does not: after so long without a frame of the node, s."""


class LinkCost(enum.Enum):
    """What a frame on a link costs."""

    FREE = "free"
    """Nothing: receivers answer each frame, so that a lost link is noticed at once."""
    AIRTIME = "airtime"
    """Time on a channel that is scarce: nothing is transmitted for the sake of the bond."""
    MONEY = "money"
    """Money, which the link counts by itself; otherwise as AIRTIME."""


class Tariff(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What frames cost on a link that costs money."""

    per_byte: Annotated[float, Meta(gt=0, le=sys.float_info.max)]
    """Price of a byte that is paid for, in any currency."""
    quantum: Annotated[int, Meta(ge=1)] = 1
    """A frame is paid for as the next multiple of so many bytes."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: One is outside its range.
        """
        check_fields(self, ConfigError)


class BondLink(msgspec.Struct, frozen=True, kw_only=True):
    """How a bond treats one of its links."""

    cost: LinkCost = LinkCost.AIRTIME
    """What a frame costs."""
    tariff: Tariff | None = None
    """The prices, where it costs money; None: they are not known."""
    probe_s: DurationOrZero = 0.0
    """Pause between two tries of a link that is out of use, s; 0: 5 s, or 600 s where frames
    cost."""
    down_after_s: DurationOrZero = 0.0
    """Silence after which it is out of use, s; 0: 3 s, or 600 s where frames cost."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: One is outside its range.
        """
        check_fields(self, ConfigError)
        if self.tariff is not None and not self.costs_money:
            raise ConfigError(f"a tariff with cost {self.cost.value}; allowed: with money")

    @property
    def answers(self) -> bool:
        """Whether receivers answer each frame."""
        return self.cost is LinkCost.FREE

    @property
    def costs_money(self) -> bool:
        """Whether a frame costs money."""
        return self.cost is LinkCost.MONEY

    @property
    def quantum_bytes(self) -> int:
        """A frame is paid for as the next multiple of so many bytes."""
        return 1 if self.tariff is None else self.tariff.quantum

    @property
    def pause_s(self) -> float:
        """Pause between two tries, s."""
        return self.probe_s or (PROBE_S if self.answers else SILENT_AFTER_S)

    @property
    def silence_s(self) -> float:
        """Silence after which the link is out of use, s."""
        return self.down_after_s or (DOWN_AFTER_S if self.answers else SILENT_AFTER_S)


class Bond(msgspec.Struct, frozen=True, kw_only=True):
    """A list of links, the best one first; the last one is used when no other is up."""

    number: int
    """Its number on the wire, 1…31, which no route has; the same at all nodes."""
    links: tuple[str, ...]
    """Names of the links, at least two different ones."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: One is outside its range.
        """
        if not 1 <= self.number <= LAST_ROUTE:
            raise ConfigError(f"bond {self.name}: number {self.number}; allowed: 1..{LAST_ROUTE}")
        if len(self.links) < 2 or len(set(self.links)) < len(self.links):
            raise ConfigError(
                f"links: {', '.join(self.links) or 'none'}; allowed: two or more, each once"
            )

    @property
    def name(self) -> str:
        """Name of the link that the bond is for its streams."""
        return "+".join(self.links)
