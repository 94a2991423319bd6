"""The unit of docs/deploy.md starts what the command line takes, and may do what that needs."""

import configparser
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Final

import pytest

from tests.pages.blocks import ROOT, files_of
from zacoustic.app.cli import parse

FILES: Final = files_of("docs/deploy.md")
UNIT: Final = FILES["/etc/systemd/system/zacoustic.service"]
EXPOSURE_MAX: Final = 4.0
"""The highest rating of `systemd-analyze security`; 10 is a service without any restriction."""

NEEDS_SYSTEMD: Final = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed"
)


def service() -> dict[str, list[str]]:
    """The settings of all sections; a setting may be there several times."""
    settings: dict[str, list[str]] = {}
    for line in UNIT.splitlines():
        name, equals, value = line.partition("=")
        if equals:
            settings.setdefault(name, []).append(value)
    return settings


def test_the_service_starts_a_gateway() -> None:
    (start,) = service()["ExecStart"]
    program, *arguments = shlex.split(start)
    assert program == "/opt/zacoustic/bin/zacoustic"
    verb, parsed = parse(arguments)
    assert verb.name == "gateway"
    assert (parsed.address, parsed.journal) == (2, "/var/lib/zacoustic/journal")


def test_the_service_may_write_where_its_journal_is() -> None:
    settings = service()
    (state,) = settings["StateDirectory"]
    assert f"/var/lib/{state}/" in settings["ExecStart"][0]
    (configuration,) = settings["ConfigurationDirectory"]
    assert f"/etc/{configuration}/" in settings["ExecStart"][0]


def test_the_page_shows_the_unit_that_is_shipped() -> None:
    assert (ROOT / "examples" / "deploy" / "zacoustic.service").read_text("utf-8") == UNIT


def test_the_service_may_open_serial_ports_and_the_sockets_of_zenoh() -> None:
    settings = service()
    assert settings["PrivateDevices"] == ["no"]
    assert {"char-ttyUSB rw", "char-ttyACM rw", "char-ttyS rw"} <= {*settings["DeviceAllow"]}
    (families,) = settings["RestrictAddressFamilies"]
    assert set(families.split()) == {"AF_INET", "AF_INET6", "AF_UNIX", "AF_NETLINK"}
    assert "IPAddressDeny" not in settings
    assert "PrivateNetwork" not in settings


def test_the_service_may_ask_how_wrong_the_clock_is_and_not_set_it() -> None:
    """Where the kernel's report is forbidden, a gateway trusts its file without a word."""
    settings = service()
    assert "ProtectClock" not in settings
    assert set(settings["SystemCallFilter"][-1].split()) >= {"adjtimex", "clock_adjtime"}
    assert settings["CapabilityBoundingSet"] == [""]


def test_the_service_may_read_the_name_of_the_boot() -> None:
    """It is in /proc/sys, which `ProcSubset=pid` hides."""
    assert "ProcSubset" not in service()


@NEEDS_SYSTEMD
def test_the_unit_is_hardened(tmp_path: Path) -> None:
    unit = tmp_path / "zacoustic.service"
    unit.write_text(UNIT, encoding="utf-8")
    process = subprocess.run(
        ["systemd-analyze", "security", "--offline=yes", "--no-pager", unit],
        capture_output=True,
        text=True,
        check=False,
    )
    rated = re.search(r"Overall exposure level for zacoustic.service: ([\d.]+)", process.stdout)
    if rated is None:
        pytest.skip(f"this systemd rates no file: {process.stderr.strip()}")
    assert float(rated[1]) <= EXPOSURE_MAX, process.stdout


@NEEDS_SYSTEMD
def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    unit = tmp_path / "zacoustic.service"
    unit.write_text(UNIT.replace("/opt/zacoustic/bin/zacoustic", "/bin/true"), encoding="utf-8")
    process = subprocess.run(
        ["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr


def test_the_unit_is_an_ini_file_with_the_three_sections() -> None:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.read_string(UNIT)
    assert parser.sections() == ["Unit", "Service", "Install"]
