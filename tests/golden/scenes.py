"""The scenes of `tests/golden/conversations`: makes a file of each.

After changing one: ``python -m tests.golden.scenes NAME`` from the project's root.
"""

import sys
from pathlib import Path
from typing import Any, Final

import msgspec

from tests.golden.conversation import Conversation, Given, Scene, record
from tests.golden.sealed import KEY
from tests.golden.tables import NAV_VALUE, lines

FOLDER: Final = Path(__file__).parent / "conversations"


def _publish(at_s: float, node: int, stream_id: int, payload: bytes) -> Given:
    return Given(at_s, node, {"publish": {"stream": stream_id, "payload": payload.hex()}})


def _nav(at_s: float, node: int, stream_id: int = 10, **changed: Any) -> Given:
    value = {**NAV_VALUE, **changed}
    return Given(at_s, node, {"publish": {"stream": stream_id, "value": value}})


_CALL: Final = (
    Given(0.0, 1, {"call": {"stream": 20, "payload": "01"}}),
    Given(
        8.0,
        2,
        {"reply": {"client": 1, "epoch": 1, "stream": 20, "call": 0, "payload": b"ok".hex()}},
    ),
)
_GOAL: Final = {"client": 1, "epoch": 1, "stream": 40, "goal": 0}

SCENES: Final = (
    Scene(
        name="contact",
        about="First contact: both nodes publish, agree on their table, and then need no HELLO.",
        tables={1: "base", 2: "base"},
        given=(
            *(_nav(10.0 * count, 2, depth=10.0 + count) for count in range(6)),
            *(_publish(25.0 + 10 * count, 1, 11, b"hello") for count in range(4)),
        ),
    ),
    Scene(
        name="call",
        about="A call whose first response is lost: the server sends it again.",
        tables={1: "base", 2: "base"},
        given=_CALL,
        lost=((2, 2),),
    ),
    Scene(
        name="reliable",
        about="A reliable topic: two samples, one repetition and one ACK are lost.",
        tables={1: "reliable", 2: "reliable"},
        given=tuple(_publish(10.0 * count, 1, 30, b"order %d" % count) for count in range(8)),
        lost=((1, 2), (1, 3), (1, 6), (2, 4)),
    ),
    Scene(
        name="reliable_sealed",
        about="The samples of reliable.json with sealed frames; others are lost.",
        tables={1: "reliable", 2: "reliable"},
        given=tuple(_publish(10.0 * count, 1, 30, b"order %d" % count) for count in range(8)),
        lost=((1, 2), (1, 3), (1, 6), (2, 4)),
        key=KEY,
    ),
    Scene(
        name="object",
        about="A sample of 200 bytes in fragments, one of which is lost, between two small ones.",
        tables={1: "reliable", 2: "reliable"},
        given=(
            _publish(0.0, 1, 30, b"before"),
            _publish(20.0, 1, 30, bytes(range(200))),
            _publish(21.0, 1, 30, b"behind"),
        ),
        lost=((1, 5),),
    ),
    Scene(
        name="goal",
        about="A goal with feedback, which the client cancels; a FEEDBACK and a CANCEL are lost.",
        tables={1: "action", 2: "action"},
        given=(
            Given(0.0, 1, {"send_goal": {"stream": 40, "value": NAV_VALUE}}),
            Given(8.0, 2, {"accept": _GOAL}),
            Given(20.0, 2, {"feedback": {**_GOAL, "payload": b"near".hex()}}),
            Given(30.0, 2, {"feedback": {**_GOAL, "payload": b"nearer".hex()}}),
            Given(40.0, 1, {"cancel": _GOAL}),
            Given(48.0, 2, {"agree": _GOAL}),
            Given(60.0, 2, {"finish": {**_GOAL, "status": 5, "payload": b"up".hex()}}),
        ),
        lost=((2, 5), (1, 5)),
    ),
    Scene(
        name="tables",
        about="Tables that differ in stream 21: stream 11 crosses in both ways, 21 in none.",
        tables={1: "base", 2: "other"},
        given=(
            *(_publish(15.0 * count, 1, 11, b"one") for count in range(6)),
            *(_publish(5.0 + 15 * count, 2, 11, b"two") for count in range(6)),
            *(_publish(7.0 + 30 * count, 1, 21, b"odd") for count in range(3)),
        ),
    ),
    Scene(
        name="sealed",
        about="The call of call.json with sealed frames.",
        tables={1: "base", 2: "base"},
        given=_CALL,
        lost=((2, 2),),
        key=KEY,
    ),
    Scene(
        name="dense",
        about="A dense topic: acknowledgements ride with samples; blocks and one of them are lost.",
        tables={1: "dense", 2: "dense"},
        given=(
            *(
                _nav(10.0 * count, 2, depth=12.0 + count / 5, heading=100.0 + 2 * count)
                for count in range(16)
            ),
            *(_publish(5.0 + 20 * count, 1, 11, b"on %d" % count) for count in range(8)),
        ),
        lost=((2, 6), (2, 9), (1, 4)),
    ),
)
"""Each is played by the real engines; what is lost is chosen so that its loss matters."""


def path_of(scene: Scene) -> Path:
    """Return the file of a scene."""
    return FOLDER / f"{scene.name}.json"


def text(conversation: Conversation) -> str:
    """Return the content of its file."""
    return lines(msgspec.to_builtins(conversation)) + "\n"


def read(scene: Scene) -> Conversation:
    """Return the conversation in the file of a scene."""
    return msgspec.json.decode(path_of(scene).read_bytes(), type=Conversation)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for each in SCENES:
        if not sys.argv[1:] or each.name in sys.argv[1:]:
            path_of(each).write_text(text(record(each)), encoding="utf-8")
