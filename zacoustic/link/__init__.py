"""Links: their contract, and the tools to find and build them.

`contract` is the contract of a link; this package exports its names. `registry` finds links and
verbs, `bytestream` is TCP or a serial port behind one interface, `command` is the contract of a
verb, and `serving` helps verbs that serve until they are interrupted. `fields` and `forms` are the
two halves of a table of a device's text messages.
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
