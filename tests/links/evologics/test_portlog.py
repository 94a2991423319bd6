"""Frames are found in a log of the port, whatever stands around them and in them."""

import random
from pathlib import Path

import pytest

from zacoustic.app.cli import main
from zacoustic.link import Link, LoggedFrame
from zacoustic_evologics import EvologicsLink

TAG = bytes.fromhex("b10007")


def heard(payload: bytes, *, source: int = 2, to: int = 1) -> bytes:
    head = f"RECVIM,{len(payload)},{source},{to},noack,204800,-45,133,0.0458,"
    return head.encode() + payload + b"\r\n"


def said(payload: bytes, *, to: int = 255, word: str = "SENDIM", tail: str = "noack,") -> bytes:
    return f"AT*{word},{len(payload)},{to},{tail}".encode() + payload + b"\r"


def found(log: bytes) -> list[tuple[bytes, int, int, bool]]:
    return [
        (each.frame_bytes, each.source, each.destination, each.is_sent)
        for each in EvologicsLink.read_log(log)
    ]


def test_both_directions_are_found_between_anything_else() -> None:
    log = b"".join(
        (
            b"[12:00:01] AT?S\r\nInitiation Listen\r\n",
            said(b"abc"),
            b"OK\r\nSENDEND,255,im,1234,5678\r\n12:00:02 < ",
            heard(b"def"),
            b"+++AT" + b"*SENDPBM,2,3,xy\r\n",
            said(b"z" * 100, to=2, word="SEND", tail=""),
            b"RECVIM,99999999,2,1,noack,1,1,1,0.0,\r\nAT*SENDIM,5,1,noack,a",
        )
    )
    assert found(log) == [
        (b"abc", 1, 255, True),
        (b"def", 2, 1, False),
        (b"xy", 1, 3, True),
        (b"z" * 100, 1, 2, True),
    ]


def test_payloads_that_look_like_records_are_payloads() -> None:
    inner = heard(b"x") + said(b"y")
    assert found(said(inner[:60]) + heard(inner[:50])) == [
        (inner[:60], 1, 255, True),
        (inner[:50], 2, 1, False),
    ]


def test_nothing_raises_whatever_the_log() -> None:
    rng = random.Random(3)
    whole = b"".join(heard(rng.randbytes(20)) + said(rng.randbytes(20)) for _ in range(20))
    for _ in range(200):
        damaged = bytearray(whole)
        for _ in range(rng.randint(1, 40)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        assert len(found(bytes(damaged[rng.randrange(len(damaged)) :]))) <= 40


def test_decode_says_the_frames_of_a_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "serial.log"
    path.write_bytes(b"AT?S\r\n" + said(TAG) + b"OK\r\n" + heard(TAG))
    assert main(["decode", "--log", "evologics", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "node 1 to everybody, 3 bytes: b10007"
    assert "TAG epoch 7" in lines[1]
    assert lines[2] == "node 2 to node 1, 3 bytes: b10007"
    assert main(["decode", "--log", "evologics", str(path), "--source", "2", "--json"]) == 0
    assert capsys.readouterr().out.count("\n") == 1


def test_what_is_wrong_with_a_log_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "serial.log"
    path.write_bytes(b"AT?S\r\n")
    for arguments, code, words in (
        (["--log", "evologics", str(path)], 2, "serial.log: no frames in it"),
        (["--log", "evologics", str(tmp_path / "none")], 2, "No such file"),
        (["--log", "nonsense", str(path)], 1, "no link 'nonsense'; installed: "),
        (["--log", "evologics"], 2, "--log; allowed: with a file"),
    ):
        assert main(["decode", *arguments]) == code
        problem = capsys.readouterr().err
        assert words in problem
        assert problem.count("\n") == 1


def test_other_links_find_nothing_in_a_log() -> None:
    assert not list(Link.read_log(heard(b"abc")))
    assert isinstance(next(EvologicsLink.read_log(heard(b"abc"))), LoggedFrame)
