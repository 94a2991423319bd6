"""Whatever is on a key of ROS is a message or refused."""

import contextlib
from typing import Final

from hypothesis import given
from hypothesis import strategies as st

from tests.ros.test_messages import JAZZY, PLAIN, filled
from zacoustic.errors import PayloadInvalidError
from zacoustic.ros.attachment import read_attachment
from zacoustic.ros.messages import RosMessage
from zacoustic.ros.names import read_key
from zacoustic.ros.tokens import read_token

MESSAGES: Final = [
    RosMessage(JAZZY, PLAIN, name)
    for name in (
        "diagnostic_msgs/msg/DiagnosticArray",
        "nav_msgs/msg/Path",
        "sensor_msgs/msg/PointCloud2",
        "std_msgs/msg/Float64MultiArray",
        "std_msgs/msg/String",
        "unique_identifier_msgs/msg/UUID",
    )
]
CDR: Final = [message.write(filled(message.name)) for message in MESSAGES]
CHANGES: Final = st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), max_size=6)


@given(st.sampled_from(range(len(MESSAGES))), CHANGES, st.integers(0, 10_000))
def test_a_damaged_message_is_one_or_refused(
    which: int, changes: list[tuple[int, int]], cut: int
) -> None:
    message, cdr = MESSAGES[which], bytearray(CDR[which])
    for place, octet in changes:
        cdr[place % len(cdr)] = octet
    if cut % 3 == 0:
        cdr = cdr[: cut % (len(cdr) + 1)]
    with contextlib.suppress(PayloadInvalidError):
        value, _ = message.read(bytes(cdr))
        again = message.write(message.spec.validate(value))
        # Twice read it is the same, but for numbers that are none.
        assert message.write(message.read(again)[0]) == again


@given(st.binary(max_size=80))
def test_any_attachment_is_one_or_none(content: bytes) -> None:
    read = read_attachment(content)
    assert read is None or read.encode() == content[:33]


@given(st.text(max_size=80))
def test_any_key_and_token_is_one_or_none(text: str) -> None:
    key, token = read_key(text), read_token(f"@ros2_lv/0/{text}")
    assert key is None or read_key(str(key)) == key
    assert token is None or read_token(str(token)) == token
