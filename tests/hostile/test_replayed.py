"""A call that somebody has recorded is played back in a later life of its client."""

from tests.core.calling import acquainted, answer, call, fleet, requests
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello


def test_call_of_a_former_life_of_its_client_runs_no_more() -> None:
    rig = acquainted()
    former = rig[1].engine.epoch
    call(rig, b"arm")
    rig.run(0.5)
    assert answer(rig, b"armed")
    rig.run(100)
    rig.restart(1, fleet(), keeps=True)
    for _ in range(3):
        rig.publish(1, 1, b"again")
        rig.publish(2, 1, b"again")
        rig.run(100)
    before = len(requests(rig))
    # What it may have sent then: a frame that introduces it, with the call in it.
    hello = Hello(WIRE_VERSION, former, fleet().digest).encode()
    for number in range(64):
        rig[2].hear(hello + bytes((20, number)) + b"arm", rig.now, source=1, destination=2)
    assert len(requests(rig)) == before
    assert rig[2].engine.stats.dropped["former_life"] == 64
    # Nor in a later life of the server, which has it in its journal.
    rig.restart(2, fleet(), keeps=True)
    rig[2].hear(hello + bytes((20, 0)) + b"arm", rig.now, source=1, destination=2)
    assert requests(rig) == []
    # Its present life is served as ever.
    rig.run(100)
    call(rig, b"now")
    rig.run(5)
    assert [each.value for each in requests(rig)] == [b"now"]
