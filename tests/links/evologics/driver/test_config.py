import pytest

from zacoustic.errors import ConfigError
from zacoustic.link import convert_config
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.link import EvologicsLink


def converted(**settings: str) -> EvologicsConfig:
    config = convert_config(EvologicsConfig, settings, source="evologics/tcp:a:1")
    assert isinstance(config, EvologicsConfig)
    return config


def test_settings_are_read_from_the_text_of_a_locator() -> None:
    config = converted(
        baudrate="115200", service="burst", mtu="1024", check="true", set_address="true",
        highest_address="30", deck="true", source_level="3", gain="1", retries="2",
        extended_notifications="false", usbl="false", propagation_s="0.5", busy_s="0", wait_s="3",
    )  # fmt: skip
    assert config == EvologicsConfig(
        baudrate=115_200, service="burst", mtu=1024, check=True, set_address=True,
        highest_address=30, deck=True, source_level=3, gain=1, retries=2,
        extended_notifications=False, usbl=False, propagation_s=0.5, busy_s=0.0, wait_s=3.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"mtu": "15"}, "mtu is '15'; allowed: a number, 16..1024"),
        ({"mtu": "1025"}, "mtu is '1025'"),
        ({"mtu": "65", "service": "im"}, "mtu is 65 with service im; allowed: 16..64"),
        ({"service": "quick"}, "service is 'quick'; allowed: auto, burst, im, ims, pbm"),
        ({"service": "pbm", "mtu": "65"}, "mtu is 65 with service pbm; allowed: 16..64"),
        ({"service": "pbm", "extended_notifications": "false"}, "must be true"),
        ({"baudrate": "0"}, "baudrate is '0'"),
        ({"retries": "11"}, "retries is '11'; allowed: a number, 0..10"),
        ({"highest_address": "15"}, "highest address is 15; allowed: 2, 6, 14, 30, 62, 126, 254"),
        ({"source_level": "4"}, "source level is 4; allowed: 0..3"),
        ({"source_level": "0", "deck": "true"}, "source_level is 0 on deck; allowed: 3"),
        ({"gain": "2"}, "gain is 2; allowed: 0..1"),
        ({"propagation_s": "0"}, "propagation_s is '0'; allowed: seconds, above 0"),
        ({"reply_s": "-1"}, "reply_s is '-1'"),
        ({"wait_s": "inf"}, "wait_s is 'inf'"),
        ({"busy_s": "nan"}, "busy_s is 'nan'"),
        ({"level": "1"}, "allowed settings: baudrate, service"),
    ],
)
def test_wrong_setting_is_an_error_that_says_what_is_allowed(
    settings: dict[str, str], words: str
) -> None:
    with pytest.raises(ConfigError, match="evologics/tcp:a:1") as caught:
        converted(**settings)
    assert words in str(caught.value)


@pytest.mark.parametrize("address", ["", "a:1", "tcp:a", "tcp:a:0", "serial:", "udp:a:1"])
def test_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(ConfigError):
        EvologicsLink.from_locator(address, EvologicsConfig(), node_address=1)


@pytest.mark.parametrize("node_address", [0, 255, -1])
def test_node_address_that_is_none_is_refused(node_address: int) -> None:
    with pytest.raises(ConfigError, match=r"allowed: 1\.\.254"):
        EvologicsLink.from_locator("tcp:a:1", EvologicsConfig(), node_address=node_address)


def test_capabilities_are_the_published_ones() -> None:
    link = EvologicsLink.from_locator("tcp:a:1", EvologicsConfig(), node_address=1)
    told = link.capabilities
    assert told.mtu_bytes == 64
    assert told.airtime_ns(64) == pytest.approx(860_338_000, rel=0.001)
    assert 64 * 8 / (told.airtime_ns(64) / 1e9 + told.gap_s) == pytest.approx(539, abs=1)
    assert (told.addressed, told.checked, told.framed) == (True, True, True)
    assert not told.controls_access
    unchecked = EvologicsLink.from_locator("tcp:a:1", EvologicsConfig(check=True), node_address=1)
    assert not unchecked.capabilities.checked


@pytest.mark.parametrize("settings", [{"service": "im"}, {"mtu": "1024"}])
def test_bulk_needs_messages_and_bursts_side_by_side(settings: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match="bulk is true"):
        converted(bulk="true", **settings)
