"""The controls of the native wire: the forms of all components that use it."""

from typing import Final

from zacoustic.core.wire import access, agreement, objects, subscriptions
from zacoustic.core.wire.controls import Controls

CONTROLS: Final = Controls(*agreement.FORMS, *access.FORMS, *objects.FORMS, *subscriptions.FORMS)
"""LEN, the prefixes of records, and acknowledgements of dense blocks are in `wire.frame`."""
