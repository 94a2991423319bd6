"""`zacoustic completion`: scripts that shells take, and what they complete."""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("shtab")

from zacoustic.app.cli import complete_parser, main
from zacoustic.app.cli.host.completion import SHELLS
from zacoustic.app.cli.verbs import VERBS

# Calls the function of the script as bash does, and prints what it offers.
COMPLETE = """
source "$1"; shift
name=$(complete -p zacoustic | sed -n 's/.*-F \\([^ ]*\\).*/\\1/p')
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
"$name" zacoustic "${COMP_WORDS[$COMP_CWORD]}" "${COMP_WORDS[$COMP_CWORD - 1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


FLEET = """{ plugins: { acoustic: { address: 1,
  nodes: [ { address: 1, name: "shore" }, { address: 2, name: "auv1" } ],
  streams: [ { id: 1, topic: "auv1/nav" }, { id: 2, service: "auv1/arm", server: 2 } ] } } }"""


@pytest.mark.parametrize("shell", SHELLS)
def test_script_knows_every_verb(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for verb in (*VERBS, "run medium", "run modems"):
        assert all(word in script for word in verb.split()), verb
    program = shutil.which(shell)
    if program is not None:
        checked = subprocess.run(
            [program, "-n"], input=script, capture_output=True, text=True, check=False, timeout=60
        )
        assert (checked.returncode, checked.stderr) == (0, "")


def environment(folder: Path) -> dict[str, str]:
    """Return one in which `zacoustic` is this program, for a script that asks it for names."""
    program = folder / "bin" / "zacoustic"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m zacoustic "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    return {**os.environ, "PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}"}


@pytest.mark.skipif(shutil.which("bash") is None, reason="NOT RUN: no bash")
@pytest.mark.parametrize(
    ("words", "offered", "not_offered"),
    [
        (["mon"], {"monitor"}, {"gateway", "run"}),
        (["run", "modems", ""], {"desert", "evologics"}, {"monitor"}),
        (["sim", "fle"], {"fleet.json5"}, {"folder"}),
        (["sim", "campaign", "--w"], {"--workers"}, set()),
        (["ping", "--"], {"--count", "--interval", "--timeout", "--json"}, {"--once"}),
        (["completion", ""], set(SHELLS), set()),
        (["config", "check", "fle"], {"fleet.json5"}, {"folder"}),
        (["decode", "fle"], {"fleet.json5"}, set()),
        (["config", "doctor", "a", "--recording", "fle"], {"fleet.json5"}, set()),
        (["replay", "a", "--through", "fle"], {"fleet.json5"}, set()),
        (["topic", "echo", "auv"], {"auv1/nav"}, {"auv1/arm"}),
        (["service", "call", "--config", "fleet.json5", ""], {"auv1/arm"}, {"auv1/nav"}),
        (["stream", ""], {"auv1/nav", "auv1/arm"}, {"1"}),
        (["stream", "auv1/nav", "--node", ""], {"1", "2"}, {"auv1/nav"}),
        (["ping", ""], {"1", "2"}, set()),
    ],
)
def test_bash_completes(
    words: list[str],
    offered: set[str],
    not_offered: set[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "script"
    script.write_text(capsys.readouterr().out, encoding="utf-8")
    (tmp_path / "fleet.json5").write_text(FLEET, encoding="utf-8")
    (tmp_path / "other.json5").touch()
    command = ["bash", "-c", COMPLETE, "bash", str(script), "zacoustic", *words]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment(tmp_path), capture_output=True, text=True,
        check=False, timeout=60,
    )  # fmt: skip
    found = set(done.stdout.split())
    assert offered <= found, done
    assert not found & not_offered


def test_parser_of_all_verbs_reads_each_of_them() -> None:
    parser = complete_parser()
    choices = next(
        each for each in parser._actions if isinstance(each, argparse._SubParsersAction)
    ).choices
    assert {verb.split()[0] for verb in VERBS} == set(choices)
    assert parser.parse_args(["ping", "2", "--count", "3"]).count == 3
