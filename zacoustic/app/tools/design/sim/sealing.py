"""Engines whose frames are sealed as the config says, with a key that stands in for the fleet's.

A seal's size does not depend on the key, so none is read: a plan needs no secret. Each start of a
node is a life of its own, whatever its journal keeps.
"""

import hashlib
from collections.abc import Callable, Mapping
from typing import Any, Final

from zacoustic.config import Config
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.errors import ConfigError
from zacoustic.seal.keys import FleetKey
from zacoustic.seal.spec import SecuritySpec
from zacoustic.text.installing import with_extra

_STAND_IN: Final = FleetKey(
    network="simulation", generation=1, secret=hashlib.sha256(b"simulation").digest()
)


def security_of(configs: Mapping[int, Config]) -> dict[int, SecuritySpec]:
    """Return the section `security` of each node that has one."""
    return {
        address: config.security
        for address, config in configs.items()
        if config.security is not None
    }


def sealed(
    security: Mapping[int, SecuritySpec], make: Callable[..., Engine] = Engine
) -> MakeEngine:
    """Return how to make the engines of a fleet, sealed if its config says so.

    Args:
        security: The section of each node that has one.
        make: Makes an engine; takes a `cipher` as well.

    Raises:
        ConfigError: The extra `secure` is not installed.
    """
    if not security:
        return make
    try:
        from zacoustic.seal.ccm import FleetCipher
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package == "zacoustic":
            raise
        source = next(iter(security.values())).source
        raise ConfigError(
            f"{source}: needs {package}, which is not installed", hint=with_extra("secure")
        ) from error
    lives: dict[int, int] = {}

    def build(*, address: int, epoch: int, **settings: Any) -> Engine:  # noqa: ANN401
        spec = security.get(address)
        if spec is None:
            return make(address=address, epoch=epoch, **settings)
        lives[address] = max(epoch, lives.get(address, 0) + 1)
        cipher = FleetCipher(_STAND_IN, mode=spec.mode)
        return make(address=address, epoch=lives[address], cipher=cipher, **settings)

    return build
