"""Interface definitions and their hashes: of all distributions, and of own packages."""

import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.ros.captures import PUBLISHED_HASHES
from zacoustic.errors import ConfigError
from zacoustic.ros.interfaces import Interfaces, distros
from zacoustic.ros.members import Member
from zacoustic.ros.names import NO_HASH

WITHOUT: Final = """
import sys


class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"rosbags", "xxhash", "numpy"}:
            raise ModuleNotFoundError(f"not there in this test: {name}", name=name)


sys.meta_path.insert(0, Absent())
from zacoustic.config import config_from_mapping
from zacoustic.errors import ConfigError

section = {"address": 1, "streams": [{"id": 1, "topic": "hello"}]}
config_from_mapping(section, source="test")
section["streams"][0] |= {"type": "std_msgs/msg/String"}
try:
    config_from_mapping(section, source="test")
except ConfigError as error:
    print(error)
"""


@pytest.mark.parametrize("name", PUBLISHED_HASHES)
def test_hashes_are_those_of_ros(name: str) -> None:
    for distro in distros():
        if distro != "humble":
            digest = Interfaces(distro).hash_of(name)
            assert digest.startswith(f"RIHS01_{PUBLISHED_HASHES[name]}"), distro


def test_humble_has_no_hashes() -> None:
    assert Interfaces("humble").hash_of("geometry_msgs/msg/Twist") == NO_HASH


def test_every_interface_of_every_distribution_has_a_hash_and_can_be_written() -> None:
    assert set(distros()) >= {"humble", "iron", "jazzy", "kilted"}
    for distro in distros():
        interfaces = Interfaces(distro)
        names = [name for name in interfaces._members if name.count("/") == 2]
        assert len(names) > 200
        for name in names:
            interfaces.hash_of(name)
            interfaces.store(name)


def test_rolling_is_the_newest() -> None:
    newest, rolling = Interfaces(distros()[-1]), Interfaces("rolling")
    assert newest.hash_of("std_srvs/srv/SetBool") == rolling.hash_of("std_srvs/srv/SetBool")


def test_own_packages_are_read_from_a_folder(tmp_path: Path) -> None:
    texts = {
        "my_msgs/msg/Leg.msg": "uint8 FAST=1\nfloat64[<=4] depths\nstring<=10 name\nTank[2] tanks",
        "my_msgs/msg/Tank.msg": "# a comment\nuint8[16] id\nstd_msgs/Header header\n",
        "my_msgs/srv/Dive.srv": "Leg leg\n---\nbool ok\n",
        "my_msgs/action/Survey.action": "Leg[] legs\n--- # result\nint32 done\n---\nfloat32 left\n",
    }
    for path, text in texts.items():
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    interfaces = Interfaces("jazzy", tmp_path)
    assert interfaces.members("my_msgs/msg/Leg") == (
        Member(name="depths", type="float64", is_sequence=True, count=4),
        Member(name="name", type="string", most_characters=10),
        Member(name="tanks", type="my_msgs/msg/Tank", is_array=True, count=2),
    )
    assert interfaces.members("my_msgs/srv/Dive_Request")[0].type == "my_msgs/msg/Leg"
    assert interfaces.members("my_msgs/action/Survey_Feedback")[0].name == "left"
    for name in ("my_msgs/srv/Dive", "my_msgs/action/Survey_SendGoal"):
        assert interfaces.hash_of(name).startswith("RIHS01_")
        interfaces.store(f"{name}_Request")


@pytest.mark.parametrize(
    ("path", "text", "expected"),
    [
        ("my_msgs/msg/Leg.msg", "float64 1x", "no definition"),
        ("my_msgs/srv/Dive.srv", "bool ok", "0 lines of ---; allowed: 1 in a .srv file"),
        ("my_msgs/Leg.msg", "bool ok", "stands elsewhere; allowed: PACKAGE/msg/Name.msg"),
        ("my_msgs/readme.txt", "", "has no .msg, .srv or .action file"),
    ],
)
def test_what_is_no_definition_is_named(
    tmp_path: Path, path: str, text: str, expected: str
) -> None:
    file = tmp_path / path
    file.parent.mkdir(parents=True)
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        Interfaces("jazzy", tmp_path)
    assert expected in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_an_unknown_interface_is_an_error_with_a_hint() -> None:
    with pytest.raises(ConfigError, match="no interface of jazzy") as caught:
        Interfaces("jazzy").members("geometry_msgs/msg/Twst")
    assert caught.value.hint == 'did you mean "geometry_msgs/msg/Twist"?'
    with pytest.raises(ConfigError, match="allowed: humble, iron, jazzy"):
        Interfaces("jezzy")


def test_without_the_extra_all_but_ros_works_and_the_error_names_it() -> None:
    process = subprocess.run(
        [sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=False, timeout=60
    )
    assert process.returncode == 0, process.stderr
    assert "zacoustic[ros]" in process.stdout
    assert "needs the package rosbags" in process.stdout
