"""The examination ends, whatever the modem does; the doctor's tests have its findings."""

import asyncio

import pytest

from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.examination import examine

STATUS = (
    b"Local Address: 1\nRemote Address: 0\nAcoustic Link Status: INITIATION LISTEN\n"
    b"Pool Status: 0\nPromiscuous Mode: OFF\n"
)
HEALTHY = {
    b"AT?S": STATUS,
    b"AT?MODE": b"NET",
    b"ATI0": b"1.9",
    b"AT?AL": b"1",
    b"AT?AM": b"14",
    b"AT?L": b"0",
    b"AT?G": b"0",
}


async def found(answers: dict[bytes, bytes], times: int = 1000) -> list[str]:
    """Examine a modem that answers these commands so many times, and leaves all others unanswered.

    Returns:
        The faults that were found.
    """
    left = dict.fromkeys(answers, times)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := await reader.readline():
            command = line.strip()
            left[command] = left.get(command, 0) - 1
            if command.startswith(b"+++"):
                writer.write(b"ERROR WRONG FORMAT\r\n")
            elif left[command] >= 0:
                writer.write(answers[command] + b"\r\n")
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        port = server.sockets[0].getsockname()[1]
        config = EvologicsConfig(reply_s=0.2)
        return [each.what for each in await examine(f"tcp:127.0.0.1:{port}", config, 1, 5.0)]


def test_healthy_modem_has_no_fault() -> None:
    assert asyncio.run(found(HEALTHY)) == []


def test_query_that_is_never_answered_costs_only_itself() -> None:
    answers = {command: text for command, text in HEALTHY.items() if command != b"ATI0"}
    (firmware,) = asyncio.run(found(answers))
    assert firmware.startswith("firmware of the modem is unknown: it answers 'nothing'")


@pytest.mark.parametrize("known", [{}, {b"AT?MODE": b"NET"}])
def test_modem_that_falls_silent_does_not_answer(known: dict[bytes, bytes]) -> None:
    (silent,) = asyncio.run(found(known, times=1))
    assert "no modem answers" in silent
