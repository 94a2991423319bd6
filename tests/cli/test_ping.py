"""`zacoustic ping`: through a gateway and on a link, its statistics, its cost, its errors."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.cli.watched import WATCHED, lines_of, pair
from tests.gateway.networkpair import verb
from tests.gateway.networks import SECTION, get, run
from tests.node.fleet import ChannelServer
from zacoustic.app.cli import main
from zacoustic.app.cli.use.ping import _text
from zacoustic.app.tools.field.pinging import Ping, statistics_of
from zacoustic.core.engine.events import CallFailed, CallFailure
from zacoustic.core.linktypes import LinkState
from zacoustic.zenoh.requests.context import Asking, RequestContext
from zacoustic.zenoh.requests.ping import PingAnswer, PingAsked, _Ping

ONCE = ["--count", "1"]


def test_ping_tells_round_trip_range_and_signal(capsys: pytest.CaptureFixture[str]) -> None:
    async def scene() -> None:
        async with pair(profile="evologics_s2c_18_34", time_scale=20.0) as found:
            assert await verb("ping", "2", *found.where, *ONCE) == 0
            first, sent, *_ = capsys.readouterr().out.splitlines()
            for word in ("1: node 2 by 1: round trip ", " m, ", "SNR "):
                assert word in first
            assert sent == "node 2: 1 sent, 1 answered, 0% lost"

    run(scene())


def test_ping_as_json_is_one_line_each_and_statistics(capsys: pytest.CaptureFixture[str]) -> None:
    async def scene() -> None:
        async with pair() as found:
            words = ["--count", "3", "--interval", "0.001", "--json"]
            assert await verb("ping", "2", *found.where, *words) == 0

    run(scene())
    *pings, end = lines_of(capsys)
    assert [each["number"] for each in pings] == [1, 2, 3]
    for each in pings:
        assert (each["node"], each["by"], each["answered"]) == (2, 1, True)
        assert each["range_m"] == 1.0
        assert 0 < each["round_trip_s"] < 5
        assert 0 <= each["range_age_s"] < 5  # the machine may be busy between the two
    found = end["statistics"]
    assert (found["sent"], found["answered"], found["range_m"]["mean"]) == (3, 3, 1.0)


def test_a_node_that_takes_no_commands_of_us_answers_a_ping_all_the_same(
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def scene() -> None:
        section = WATCHED | {"commands_from": [3]}
        async with pair(acknowledges=False, section=section) as found:
            assert await verb("ping", "2", *found.where, *ONCE, "--json") == 0

    run(scene())
    answer = lines_of(capsys)[0]
    assert answer["answered"]
    assert answer["round_trip_s"] > 0


@pytest.mark.parametrize("acknowledges", [True, False])
def test_where_no_commands_cross_the_range_alone_has_to_do(
    acknowledges: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    async def scene() -> int:
        taken = {"id": 175, "topic": "taken", "publishers": [1]}
        section = WATCHED | {"streams": [*WATCHED["streams"], taken]}
        async with pair(acknowledges=acknowledges, section=section) as found:
            return await verb("ping", "2", *found.where, *ONCE, "--json")

    code = run(scene())
    if acknowledges:
        assert code == 0
        answer = lines_of(capsys)[0]
        assert (answer["round_trip_s"], answer["range_m"]) == (None, 1.0)
    else:
        assert code == 1
        error = capsys.readouterr().err
        assert "stream 175 is taken, so no commands cross the channel" in error
        assert "and the modem measures no range" in error


def test_ping_of_nobody_is_exit_code_3_and_of_the_own_local_network_1(
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def scene() -> None:
        async with pair() as found:
            quick = [*ONCE, "--timeout", "0.2"]
            assert await verb("ping", "3", *found.where, *quick) == 3
            assert "no answer in time" in capsys.readouterr().out
            assert await verb("ping", "1", *found.where, *quick) == 1
            assert "node 1 is on this local network" in capsys.readouterr().err
            assert await verb("ping", "99", *found.where, *quick) == 1
            assert "no gateway that knows node 99" in capsys.readouterr().err
            for parameters in ("within_s=x", "within_s=0", "within_s=601", "until=3"):
                replies = await get(found.shore, f"@acoustic/2/ping?{parameters}")
                assert "BAD_REQUEST" in replies.errors[0], parameters
            # Looking around pings nobody.
            before = len(found.channel.emissions)
            await get(found.shore, "@acoustic/**")
            await get(found.shore, "@acoustic/*/ping")
            assert len(found.channel.emissions) == before

    run(scene())


def test_ping_on_a_link_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "fleet.json5"
    file.write_text(json.dumps({"plugins": {"acoustic": SECTION}}), encoding="utf-8")

    async def scene(locator: str) -> None:
        from zacoustic import Node

        async with Node("auv1", config=str(file), link=locator):
            where = ["--link", f"{locator}#acknowledges=true", "--config", str(file)]
            assert await verb("ping", "auv1", *where, *ONCE, "--json") == 0

    with ChannelServer() as locator:
        run(scene(locator))
    answer = lines_of(capsys)[0]
    assert (answer["node"], answer["by"], answer["answered"]) == (2, 1, True)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["auv1"], "a name needs --config FILE"),
        (["300"], "allowed: 1..254"),
        (["2", "--count", "0"], "--count 0; allowed"),
        (["2", "--timeout", "700"], "allowed: above 0, 1e-06..600"),
    ],
)
def test_wrong_arguments_of_ping_are_exit_code_2(
    words: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ping", *words]) == 2
    assert text in capsys.readouterr().err


def test_statistics_leave_out_what_was_not_answered() -> None:
    def ping(number: int, round_trip_s: float | None) -> Ping:
        answer = PingAnswer(address=2, by=1, round_trip_s=round_trip_s)
        return Ping(number=number, answer=answer if round_trip_s else None, unix_s=0.0)

    found = statistics_of([ping(1, 2.0), ping(2, None), ping(3, 4.0)])
    assert (found.sent, found.answered, found.range_m) == (3, 2, None)
    spread = found.round_trip_s
    assert spread is not None
    assert (spread.least, spread.mean, spread.most, spread.deviation) == (2.0, 3.0, 4.0, 1.0)
    assert statistics_of([]).sent == 0


def test_a_ping_says_that_the_link_is_down() -> None:
    down = SimpleNamespace(state=LinkState.DOWN, detail="connection refused")
    up = SimpleNamespace(state=LinkState.UP, detail="")
    said: list[str] = []
    held: Any = SimpleNamespace(refuse=lambda failure, text: said.append(text))
    for sides in ([down], [down, up]):
        runner: Any = SimpleNamespace(sides=sides)
        nobody: Any = None
        context = RequestContext(runner, nobody, clock=lambda: 0, utc_ns=lambda: 0)
        asking: Asking[PingAsked, PingAnswer] = Asking(context, held, 2, PingAsked(), 5.0)
        event = CallFailed(call_id=1, stream_id=0, failure=CallFailure.TIMED_OUT, text="")
        _Ping(asking, 0).take(event)
    why = "node 2 has not answered: the link is down, connection refused"
    assert said == [why, "node 2 has not answered in time"]
    assert _text(2, Ping(number=1, answer=None, unix_s=0.0, why=why)) == f"1: {why}"
