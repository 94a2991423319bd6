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
        ("my_msgs/readme.txt", "", "has no .msg, .srv, .action or .idl file"),
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


IDL_PACKAGE: Final = {
    "example_msgs/msg/Twin.idl": """
        // generated from rosidl_adapter/resource/msg.idl.em
        #include "geometry_msgs/msg/Vector3.idl"
        module example_msgs { module msg {
            module Twin_Constants { const int32 MOST = 5; };
            @verbatim (language="comment", text="a twist of another name")
            struct Twin {
                geometry_msgs::msg::Vector3 linear;
                @unit (value="rad/s") geometry_msgs::msg::Vector3 angular;
                sequence<float, 4> weights;
                string<10> label;
            };
        }; };""",
    "example_msgs/srv/Arm.idl": """
        module example_msgs { module srv {
            struct Arm_Request { uint8 structure_needs_at_least_one_member; };
            struct Arm_Response { boolean ok; string text; };
        }; };""",
    "example_msgs/action/Dive.idl": """
        module example_msgs { module action {
            struct Dive_Goal { double depth; };
            struct Dive_Result { double depth; };
            struct Dive_Feedback { double left; };
        }; };""",
}
SAME_PACKAGE: Final = {
    "example_msgs/msg/Twin.msg": "int32 MOST=5\ngeometry_msgs/Vector3 linear\n"
    "geometry_msgs/Vector3 angular\nfloat32[<=4] weights\nstring<=10 label\n",
    "example_msgs/srv/Arm.srv": "---\nbool ok\nstring text\n",
    "example_msgs/action/Dive.action": "float64 depth\n---\nfloat64 depth\n---\nfloat64 left\n",
}


def wide_idl(kind: str) -> str:
    return f"module m_msgs {{ module msg {{ struct Wide {{ {kind} c; }}; }}; }};"


def packages(folder: Path, files: dict[str, str]) -> Interfaces:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return Interfaces("jazzy", folder)


def test_idl_files_define_the_same_as_those_they_are_made_of(tmp_path: Path) -> None:
    old, new = packages(tmp_path / "old", SAME_PACKAGE), packages(tmp_path / "new", IDL_PACKAGE)
    for name in ("msg/Twin", "srv/Arm", "action/Dive_SendGoal", "action/Dive_GetResult"):
        assert new.hash_of(f"example_msgs/{name}") == old.hash_of(f"example_msgs/{name}"), name
    assert new.members("example_msgs/srv/Arm_Request") == old.members(
        "example_msgs/srv/Arm_Request"
    )
    new.store("example_msgs/action/Dive_Goal")


def test_idl_files_that_ros_has_made_of_others_are_passed_over(tmp_path: Path) -> None:
    made = {"example_msgs/msg/Twin.idl": "not read", "example_msgs/srv/Arm.idl": "not read"}
    both = packages(tmp_path, SAME_PACKAGE | made)
    assert "example_msgs/msg/Twin" in both


@pytest.mark.parametrize(
    ("file", "text", "kind"),
    [
        ("msg/Wide.msg", "int32 a\nwstring text\n", "wstring"),
        ("msg/Wide.msg", "wstring<=5 text\n", "wstring"),
        ("msg/Wide.msg", "wstring[] texts\n", "wstring"),
        ("msg/Wide.idl", wide_idl("char"), "char"),
        ("msg/Wide.idl", wide_idl("wstring"), "wstring"),
    ],
)
def test_who_uses_a_type_that_cannot_cross_is_told(
    tmp_path: Path, file: str, text: str, kind: str
) -> None:
    found = packages(tmp_path, {f"m_msgs/{file}": text, "m_msgs/msg/Fine.msg": "char c\n"})
    # A package may have them, as long as nobody uses them.
    found.hash_of("m_msgs/msg/Fine")
    with pytest.raises(ConfigError, match=f"m_msgs: a member is a {kind}, which cannot cross"):
        found.hash_of("m_msgs/msg/Wide")


def test_an_idl_file_of_something_else_is_named(tmp_path: Path) -> None:
    text = "module m_msgs { module msg { struct Other { double x; }; }; };"
    with pytest.raises(ConfigError, match=r"Wide\.idl: m_msgs/msg/Wide: the file has no struct"):
        packages(tmp_path, {"m_msgs/msg/Wide.idl": text})
    with pytest.raises(ConfigError, match=r"Wide\.idl: m_msgs/msg/Wide: no definition"):
        packages(tmp_path, {"m_msgs/msg/Wide.idl": "struct {"})


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
    assert "pip install '.[ros]'" in process.stdout
    assert "needs the package rosbags" in process.stdout
