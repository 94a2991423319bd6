import argparse
import re
import subprocess
import sys
from pathlib import Path

import pytest

from zacoustic.errors import ConfigError, LinkUnavailableError
from zacoustic.link import registry
from zacoustic_sim.link import SimLink

MODULE = """
from zacoustic.link import Link
from zacoustic.command import Command

class OldLink(Link):
    '''A link of another time.

    With more text.
    '''
    link_api = 0

class NoLink:
    pass

class Verb(Command):
    name = "verb"
    summary = "does it"

    def add_arguments(self, parser):
        pass

    def run(self, arguments):
        return 0
"""

ENTRY_POINTS = """
[zacoustic.links]
old = thirdparty_links:OldLink
absent = thirdparty_links:Absent
none = thirdparty_links:NoLink
needy = thirdparty_needy:Link

[zacoustic.commands]
verb = thirdparty_links:Verb
broken = thirdparty_needy:Verb
wrong = thirdparty_links:NoLink
emulate.vendor = thirdparty_needy:Verb
"""
OURS = ["desert", "sim"]
"""Our own links, some of them."""


@pytest.fixture
def third_party(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A distribution of somebody else, with links and verbs in all states."""
    info = tmp_path / "thirdparty-2.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: thirdparty\nVersion: 2.5\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    (tmp_path / "thirdparty_links.py").write_text(MODULE)
    (tmp_path / "thirdparty_needy.py").write_text("import vendor_driver_that_is_absent\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "thirdparty_links", raising=False)


def test_our_own_link_is_found_and_built_by_its_locator() -> None:
    assert set(OURS) <= set(registry.names())
    desert = registry.create("desert/127.0.0.1:4000#max_read_length=512&framing=rmw_desert", 2)
    assert desert.capabilities.mtu_bytes == 255
    link = registry.create("sim/127.0.0.1:7000#addressed=false&wait_s=3", 2)
    assert isinstance(link, SimLink)
    assert link._config.addressed is False
    assert link._config.wait_s == 3.0


@pytest.mark.parametrize(
    ("locator", "message"),
    [
        ("sim", "locator 'sim' names no link (write NAME/ADDRESS"),
        ("/x", "locator '/x' names no link"),
        ("sim/h:1#addressed", "setting 'addressed' is not key=value"),
        ("sim/h:1#=1", "setting '=1' is not key=value"),
        ("sim/h:1#framed=true&framed=false", "setting 'framed' is given twice"),
        ("sim/h:1#speed=9", "unknown setting 'speed'; allowed settings: addressed"),
        ("sim/h:1#framed=maybe", "framed is 'maybe'; allowed: true, false"),
        ("sim/h:1#wait_s=0", "wait_s is '0'; allowed: seconds, above 0"),
        ("sim/nowhere", "allowed: tcp:HOST:PORT"),
    ],
)
def test_wrong_locator_is_an_error_of_the_config(locator: str, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        registry.create(locator, 1)


def test_address_of_a_locator_may_contain_what_separates_elsewhere() -> None:
    parts = registry.parse_locator("evologics/serial:/dev/ttyUSB0#baudrate=19200&note=a=b")
    assert parts.name == "evologics"
    assert parts.address == "serial:/dev/ttyUSB0"
    assert parts.settings == {"baudrate": "19200", "note": "a=b"}


@pytest.mark.usefixtures("third_party")
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sonar", "no link 'sonar'; installed: absent, desert"),
        ("needy", "link 'needy' needs vendor_driver_that_is_absent "
                  "(pip install thirdparty[needy])"),
        ("absent", "link 'absent': thirdparty_links:Absent does not exist"),
        ("none", "link 'none': thirdparty_links:NoLink is not a subclass of Link"),
        ("old", "link 'old' was written for link contract 0, this is 1 "
                "(upgrade both: pip install --upgrade thirdparty; in zacoustic's checkout: "
                "pip install -e .)"),
    ],
)  # fmt: skip
def test_unusable_link_says_what_to_do(name: str, message: str) -> None:
    with pytest.raises(LinkUnavailableError) as caught:
        registry.load(name)
    assert str(caught.value).startswith(message)


@pytest.mark.usefixtures("third_party")
def test_description_lists_all_links_with_settings_or_error() -> None:
    described = {link.name: link for link in registry.describe()}
    assert list(described) == registry.names() == sorted(described)
    assert {"absent", "needy", "none", "old", *OURS} <= set(described)
    assert described["sim"].summary.startswith("A modem on a simulated channel")
    assert described["sim"].settings["addressed"] == "true"
    assert described["sim"].package.startswith("zacoustic ")
    assert described["needy"].package == "thirdparty 2.5"
    assert "vendor_driver" in described["needy"].error


def test_without_any_link_the_installation_is_at_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "LINK_GROUP", "zacoustic.links.of.nobody")
    with pytest.raises(LinkUnavailableError, match=r"pip install -e \."):
        registry.load("sim")


@pytest.mark.usefixtures("third_party")
def test_verbs_are_found_and_a_broken_one_fails_alone() -> None:
    commands = registry.commands()
    assert list(commands) == sorted(commands)
    assert {"broken", "emulate.desert", "emulate.vendor", "medium", "verb", "wrong"} <= {*commands}
    assert commands["verb"].run(argparse.Namespace()) == 0
    assert commands["broken"].name == "broken"
    assert "not available" in commands["broken"].summary
    parser = argparse.ArgumentParser()
    commands["broken"].add_arguments(parser)
    with pytest.raises(LinkUnavailableError, match="vendor_driver"):
        commands["broken"].run(parser.parse_args(["any", "thing"]))
    with pytest.raises(LinkUnavailableError, match="is not a Command"):
        commands["wrong"].run(argparse.Namespace())
    # The extra of a sub-verb is called as its package's link, not as the whole entry point.
    with pytest.raises(LinkUnavailableError, match=r"pip install thirdparty\[vendor\]"):
        commands["emulate.vendor"].run(argparse.Namespace())


@pytest.mark.parametrize("expression", ["registry.names()", "list(registry.commands())"])
def test_names_import_nothing(expression: str) -> None:
    code = (
        f"import sys; from zacoustic.link import registry; {expression}; "
        "print([name for name in sys.modules if name.startswith('zacoustic_')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
