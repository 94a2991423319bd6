"""`zacoustic predive`: real gateways on one channel; what differs between them is named."""

import asyncio
import contextlib
import io
import json
import re
import time
from pathlib import Path
from typing import Any

import pytest

from tests.gateway.networks import Channel, local_network, run, until
from tests.tools.test_doctor_seal import EAGER, KEY, _gateway, _section
from tests.tools.ward import NODES, beside, write
from zacoustic.app.cli import main
from zacoustic.run.hostclock import ClockState, HostClock
from zacoustic.run.journal import Journal, journal_in
from zacoustic.seal.keys import new_key


def _told(path: Path, *more: str) -> tuple[int, dict[str, Any]]:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
        code = main(["predive", str(path), "--json", *more])
    return code, json.loads(said.getvalue() or "{}")


def _text(told: dict[str, Any]) -> str:
    return " | ".join(each["what"] for each in told["findings"])


def _sections(folder: Path, *keys: Any) -> list[dict[str, Any]]:
    made = []
    for number, key in enumerate(keys):
        place = folder / f"node{number}"
        place.mkdir()
        made.append({} if key is None else _section(place, key))
    return made


def test_two_sealed_ends_in_order(tmp_path: Path) -> None:
    here, there = _sections(tmp_path, KEY, KEY)

    async def scene() -> None:
        channel = Channel()
        async with (
            _gateway(1, channel, tmp_path, **here) as shore,
            _gateway(2, channel, tmp_path, **there) as auv,
        ):
            with auv.client() as session:
                session.put("auv1/nav", b"here")
                await until(lambda: channel.sent_by(2), channel.changed)
            path = beside(tmp_path, shore, streams=EAGER, **here)
            code, told = await asyncio.to_thread(_told, path)
        assert (code, told["findings"]) == (0, []), told
        (contact,) = told["contacts"]
        assert contact["address"] == 2
        assert contact["name"] == "auv1"
        assert contact["round_trip_s"] > 0
        assert contact["life"] == 1, "of its first start"
        assert contact["same_table"] is True
        assert told["sealed"] is True
        status = contact["status"]
        assert (status["journal"], status["starts"]) == ("kept", 1)
        assert abs(status["clock_ahead_s"]) <= status["clock_doubt_s"] < 10
        assert status["same_schedule"] is True
        assert told["took_s"] < 60

    run(scene())


def test_an_end_with_another_key_does_not_answer_and_is_named(tmp_path: Path) -> None:
    here, there = _sections(tmp_path, KEY, new_key("harbour"))

    async def scene() -> None:
        channel = Channel()
        async with (
            _gateway(1, channel, tmp_path, **here) as shore,
            _gateway(2, channel, tmp_path, **there) as auv,
        ):
            path = beside(tmp_path, shore, streams=EAGER, **here)
            code, told = await asyncio.to_thread(_told, path, "--timeout", "1")
            assert code == 1
            assert "node 2 auv1 does not answer" in _text(told)
            assert "no frame of it was ever heard" in _text(told)
            with auv.client() as session:
                session.put("auv1/nav", b"here")
                await until(lambda: channel.sent_by(2), channel.changed)
            code, told = await asyncio.to_thread(_told, path, "--timeout", "1")
            assert "frames came that this key does not open" in _text(told)

    run(scene())


def test_an_end_with_another_table_answers_and_is_named(tmp_path: Path) -> None:
    other = [{**EAGER[0], "stamp": "age"}, EAGER[1]]
    here, there = _sections(tmp_path, KEY, KEY)

    async def scene() -> None:
        channel = Channel()
        async with (
            _gateway(1, channel, tmp_path, **here) as shore,
            _gateway(2, channel, tmp_path, **{**there, "streams": other}),
        ):
            path = beside(tmp_path, shore, streams=EAGER, **here)
            code, told = await asyncio.to_thread(_told, path)
        assert code == 1
        assert "table mismatch: node 2" in _text(told)
        assert told["contacts"][0]["round_trip_s"] is not None

    run(scene())


@pytest.mark.parametrize(
    ("access", "named", "cure"),
    [
        (
            {"method": "tdma", "slots": [1, 2], "slot_s": 3, "max_range_m": 0.5},
            "max_range_m is 0.5",
            "set max_range_m",
        ),
        (
            {"method": "auto", "slots": [
                {"owners": [1], "for_s": 3, "range_m": 2000},
                {"owners": [2], "for_s": 3, "range_m": 0.25},
            ]},
            "slots[1].range_m is 0.25",
            "zacoustic config plan --schedule",
        ),
    ],
)  # fmt: skip
def test_a_range_beyond_what_the_slots_allow(
    access: dict[str, object], named: str, cure: str, tmp_path: Path
) -> None:
    async def scene() -> None:
        channel = Channel()
        async with (
            _gateway(1, channel, tmp_path) as shore,
            _gateway(2, channel, tmp_path),
        ):
            timed = {**access, "clock_error_s": 0.01}
            links = [{"locator": "sim/127.0.0.1:1", "access": timed}]
            path = beside(tmp_path, shore, streams=EAGER, links=links)
            code, told = await asyncio.to_thread(_told, path)
        assert code == 1
        assert told["contacts"][0]["range_m"] is not None, told
        assert f"node 2 auv1 is 1 m away; {named}" in _text(told)
        assert any(cure in each["cure"] for each in told["findings"])
        assert any("frames are not sealed" in each for each in told["left_out"])

    run(scene())


def _far_end(channel: Channel, *, journal: Journal | None, wrong_s: float) -> Any:
    host = HostClock(utc_ns=lambda: time.time_ns() + round(wrong_s * 1e9), ask=lambda: None)
    section = {"nodes": NODES, "streams": EAGER}
    return local_network(2, channel, section=section, journal=journal, host=host)


@pytest.mark.parametrize(
    ("case", "wrong_s", "named"),
    [
        ("no journal", 0.0, "node 2 auv1 has no journal"),
        ("damaged", 0.0, "node 2 auv1 has a journal in doubt"),
        ("ahead", 30.0, "the clock of node 2 auv1 is 30 s ahead of this one"),
        ("behind", -30.0, "the clock of node 2 auv1 is 30 s behind this one"),
    ],
)
def test_what_only_the_other_end_knows_is_named(
    case: str, wrong_s: float, named: str, tmp_path: Path
) -> None:
    journal = None
    if case != "no journal":
        folder = tmp_path / "there"
        journal = journal_in(folder, 2)
        if case == "damaged":
            journal.recover()
            journal.close()
            (file,) = folder.glob("*.sqlite")
            file.write_bytes(b"no database" * 1000)
            journal = journal_in(folder, 2)

    async def scene() -> None:
        channel = Channel()
        async with (
            _gateway(1, channel, tmp_path) as shore,
            _far_end(channel, journal=journal, wrong_s=wrong_s),
        ):
            path = beside(tmp_path, shore, streams=EAGER)
            code, told = await asyncio.to_thread(_told, path)
        found = [each["what"] for each in told["findings"]]
        assert code == 1
        assert len(found) == 1, found
        assert re.sub(r"is (29|31) s", "is 30 s", found[0]).startswith(named)

    run(scene())


def test_slots_that_differ_are_named(tmp_path: Path) -> None:
    access = {
        "method": "tdma", "slots": [2], "slot_s": 0.5, "clock_error_s": 0.005, "max_range_m": 30,
    }  # fmt: skip
    section = {
        "nodes": NODES, "streams": EAGER,
        "links": [{"locator": "sim/127.0.0.1:1", "access": access}],
    }  # fmt: skip
    host = HostClock(ask=lambda: ClockState(error_ns=1_000_000))

    async def scene() -> None:
        channel = Channel()
        async with (
            _gateway(1, channel, tmp_path) as shore,
            local_network(
                2, channel, section=section, journal=journal_in(tmp_path / "there", 2), host=host
            ),
        ):
            path = beside(tmp_path, shore, streams=EAGER)
            code, told = await asyncio.to_thread(_told, path)
        assert code == 1
        assert _text(told) == "node 2 auv1 has other slots or turns, or none"

    run(scene())


def test_a_journal_that_is_not_that_of_the_lives_is_named(tmp_path: Path) -> None:
    here, there = _sections(tmp_path, KEY, KEY)

    async def scene() -> None:
        channel = Channel()
        async with _gateway(2, channel, tmp_path, **there):
            pass
        (tmp_path / "journal-2").rename(tmp_path / "lost")
        async with (
            _gateway(1, channel, tmp_path, **here) as shore,
            _gateway(2, channel, tmp_path, **there) as auv,
        ):
            with auv.client() as session:
                session.put("auv1/nav", b"here")
                await until(lambda: channel.sent_by(2), channel.changed)
            path = beside(tmp_path, shore, streams=EAGER, **here)
            code, told = await asyncio.to_thread(_told, path)
        assert code == 1
        assert "node 2 auv1 has a journal in doubt" in _text(told)
        assert told["contacts"][0]["life"] == 2
        assert told["contacts"][0]["status"]["starts"] == 1

    run(scene())


def test_without_a_gateway_nothing_is_tried(tmp_path: Path) -> None:
    code, told = _told(write(tmp_path))
    assert code == 1
    assert "no gateway of node 1 runs here" in _text(told)
    assert _told(write(tmp_path), "--node", "7")[0] == 2
    assert _told(write(tmp_path), "--node", "1")[0] == 2


def test_an_end_without_a_life_record_is_named_here_as_unheard_and_there_by_its_name(
    tmp_path: Path,
) -> None:
    here, there = _sections(tmp_path, KEY, KEY)

    async def scene() -> None:
        channel = Channel()
        section = {"nodes": NODES, "streams": EAGER, **there}
        async with (
            _gateway(1, channel, tmp_path, **here) as shore,
            local_network(
                2, channel, section=section, journal=journal_in(tmp_path / "there", 2)
            ) as auv,
        ):
            path = beside(tmp_path, shore, streams=EAGER, **here)
            code, told = await asyncio.to_thread(_told, path, "--timeout", "1")
            assert code == 1
            assert "node 2 auv1 does not answer" in _text(told)
            assert "no frame of it was ever heard" in _text(told)
            path = beside(tmp_path, auv, address=2, streams=EAGER, **there)
            code, told = await asyncio.to_thread(_told, path, "--timeout", "1")
            assert code == 1
            assert "no record of the lives of node 2" in _text(told)
            assert channel.sent_by(2) == 0

    run(scene())
