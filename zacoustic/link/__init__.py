"""What a link is, and what it is found and built with.

`contract` is the contract between links and their drivers; its names are here as well. `registry`
finds links and verbs, `bytestream` is TCP or a serial port behind one interface, `command` a verb
that a link brings, `serving` a server on the loopback.
"""

from zacoustic.link.contract import (
    LINK_API,
    Finding,
    Link,
    LinkConfig,
    LinkReceiver,
    LoggedFrame,
    convert_config,
)

__all__ = [
    "LINK_API",
    "Finding",
    "Link",
    "LinkConfig",
    "LinkReceiver",
    "LoggedFrame",
    "convert_config",
]
