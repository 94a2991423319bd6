"""Why a gateway refuses the key of a file; read without Zenoh, unlike the check of a seal."""

from collections.abc import Iterator

from zacoustic.config import Config
from zacoustic.errors import ConfigError
from zacoustic.seal.keyring import open_keyring


def key_refusals(config: Config) -> Iterator[str]:
    """Say why a gateway with this file refuses its key, if the key is on this computer.

    A file may be checked where its key is not, and must not be.
    """
    security = config.security
    if security is None:
        return
    paths = [each for each in (security.key, security.members) if each is not None]
    if not all(path.exists() for path in paths):
        return
    try:
        open_keyring(security, config.address)
    except ConfigError as error:
        hint = f" ({error.hint})" if error.hint else ""
        yield f"{error.args[0]}{hint}"  # it begins with the place in the file
