"""What the shore's words do to a craft: the same between processes and in virtual time."""

from typing import Any, Final

import msgspec

from examples.auv.craft import Craft
from examples.auv.messages import ARM, HOLD, JOINTS, STOP, TAKE_PHOTO, Arm, Done, Hold, Setpoint

TOPICS: Final = (STOP, *JOINTS)
"""Commands without an answer."""
SERVICES: Final = (ARM, HOLD, TAKE_PHOTO)
"""Orders that are answered at once."""


def execute(craft: Craft, topic: str, said: dict[str, Any]) -> None:
    """Execute a sample of one of `TOPICS`."""
    if topic == STOP:
        craft.stop()
    elif topic in JOINTS:
        craft.set_joint(topic, msgspec.convert(said, Setpoint).data)


def serve(craft: Craft, service: str, asked: dict[str, Any]) -> tuple[Done, bytes]:
    """Do what a request to one of `SERVICES` asks for; gives the answer, and a picture if taken."""
    if service == ARM:
        return craft.arm(msgspec.convert(asked, Arm).armed), b""
    if service == HOLD:
        return craft.hold(msgspec.convert(asked, Hold)), b""
    return Done(True), craft.take_photo()
