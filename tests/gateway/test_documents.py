"""Each document of the health report: the struct that makes it reads it, and loses nothing."""

from typing import Any

import msgspec

from tests.cli.watched import pair
from tests.gateway.networks import cbor, get, hear, run
from zacoustic.status.peers import PeerRow
from zacoustic.status.streams import StreamsDocument
from zacoustic.status.table import document_in, kind_of

LATER = {"name": "auv1", "heard_at_unix_s": 5.0, "member_of_a_later_version": {"deep": [1]}}


def test_documents_of_a_gateway_are_read_by_the_structs_that_made_them() -> None:
    async def scene() -> None:
        async with pair() as found:
            heard = await hear(found.shore, "auv1/nav")
            payload = cbor(depth=1.0, mode="survey")
            found.auv.put("auv1/nav", payload, encoding="application/cbor")
            await heard.next()
            replies = await get(found.shore, "@acoustic/1/**")
            names = set()
            for key in replies.good:
                name = key.split("/", 2)[2]
                kind = kind_of(name)
                assert kind is not None, name
                document = msgspec.json.decode(replies.payload(key), type=kind)
                again = msgspec.to_builtins(document, str_keys=True, order="sorted")
                assert msgspec.json.encode(again) == replies.payload(key), name
                names.add(name)
            assert {"node", "link", "ledger", "peers", "streams", "channel", "events"} <= names
            assert {"objects", "journal", "dropped", "clock", "peer/2/range"} <= names

    run(scene())


def test_documents_of_other_versions_are_read_as_far_as_they_are_known() -> None:
    peers = document_in({"peers": {"2": LATER, "3": {}}}, "peers", dict[int, PeerRow])
    assert (peers[2].name, peers[2].heard_at_unix_s, peers[2].per) == ("auv1", 5.0, None)
    assert (peers[3].same_table, peers[3].metrics) == (None, None)


def test_what_is_no_document_is_an_empty_one() -> None:
    odd: list[Any] = [7, None, {"streams": 3}, {"streams": [{"name": "without id"}]}, []]
    for each in odd:
        assert document_in({"streams": each}, "streams", StreamsDocument) == StreamsDocument()
    assert document_in({}, "peers", dict[int, PeerRow]) == {}


def test_keys_without_a_struct_have_none() -> None:
    for name in ("", "nothing", "link/a/b", "peer/x/range", "peer/2/what", "peer/2", "a/b/c/d"):
        assert kind_of(name) is None, name
