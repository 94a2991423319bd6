"""The first configuration: types out of values, a file that is valid and accepts what was seen."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import cbor2
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.app.cli import main
from zacoustic.app.tools.design.first.asking import ask_about
from zacoustic.app.tools.design.first.inference import NoTypeError, infer_type
from zacoustic.app.tools.design.first.survey import SeenTopic, Survey
from zacoustic.app.tools.design.first.traffic import write_traffic
from zacoustic.app.tools.design.first.writing import HERE, THERE, Side, write_config, write_files
from zacoustic.channel.profiles import DEFAULT_PROFILE
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.config import Config, config_from_mapping
from zacoustic.config.json5 import parse_json5
from zacoustic.core.base.qos import Priority, Reliability
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.values.encoding import decode_application
from zacoustic.errors import ConfigError
from zacoustic.testing import VirtualNetwork

BOOL_HASH = "feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9"


def seen(key: str, *payloads: bytes, encoding: str = "zenoh/bytes", rate: float = 1.0) -> SeenTopic:
    sizes = [len(payload) for payload in payloads] or [0]
    return SeenTopic(
        key=key, samples=len(payloads), rate_hz=rate, encoding=encoding,
        smallest_bytes=min(sizes), largest_bytes=max(sizes), payloads=payloads,
    )  # fmt: skip


def survey(*topics: SeenTopic, services: tuple[str, ...] = (), tells: bool = True) -> Survey:
    return Survey(
        endpoint="tcp/127.0.0.1:7447", listened_s=5.0, topics=topics, services=services,
        tells_services=tells,
    )  # fmt: skip


def fields(*values: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {field.keys["name"]: field.keys for field in infer_type("T", values)[-1].fields}


def topics_of(config: Config) -> dict[str, TopicSpec]:
    return {
        stream.name: stream.spec for stream in config.table if isinstance(stream.spec, TopicSpec)
    }


def test_bounds_are_wider_than_what_was_seen() -> None:
    found = fields(
        {"n": 3, "x": 1.25, "s": "abc", "b": True}, {"n": 17, "x": -3.5, "s": "", "b": 0 > 1}
    )
    escape = {"outside": "escape"}
    assert found["n"] == {"name": "n", "type": "int32", "range": [0, 200], **escape}
    x = {"name": "x", "type": "float64", "range": [-1000, 1000], "step": 0.01, **escape}
    assert found["x"] == {**x, "unit": "m"}
    assert found["s"] == {"name": "s", "type": "string", "max_length": 16}
    assert found["b"] == {"name": "b", "type": "bool"}


def test_names_that_everybody_uses_have_their_usual_bounds() -> None:
    found = fields({"lat": 43.123456789, "lon": -5.5, "heading": 359.0})
    assert (found["lat"]["range"], found["lat"]["step"]) == ([-90.0, 90.0], 1e-6)
    assert found["lon"]["range"] == [-180.0, 180.0]
    assert found["heading"]["wraps"] is True
    assert fields({"lat": 4312.34567891234})["lat"].get("unit") is None


def test_a_measurement_with_many_digits_gets_a_thousandth_of_what_varied() -> None:
    found = fields({"q": 1.23456789012}, {"q": 3.45678901234})["q"]
    assert (found["range"], found["step"]) == ([0.0, 50.0], 0.002)
    assert fields({"q": 1.23456789012})["q"] == {"name": "q", "type": "float64"}


@pytest.mark.parametrize(
    ("name", "values", "unit", "step"),
    [
        ("depth", [10.123456, 10.2], "m", 0.01),
        ("batteryVoltage", [24.123456, 24.1], "V", 0.01),
        ("heading", [1.5707963, 0.1], "rad", 0.001),
        ("yaw", [-90.0, 12.5], "deg", 0.1),
        ("heading_deg", [1.5707963, 0.1], "deg", 0.1),
        ("water_temp", [4.123456, 4.2], "degC", 0.01),
        ("percentage", [87.25, 86.0], "%", 0.5),
    ],
)
def test_units_and_steps_are_guessed_from_names(
    name: str, values: list[float], unit: str, step: float
) -> None:
    found = fields(*({name: value} for value in values))[name]
    assert (found["unit"], found["step"]) == (unit, step)


def test_a_percentage_that_is_a_share_keeps_its_digits() -> None:
    assert fields({"percentage": 0.87}, {"percentage": 0.86})["percentage"]["step"] == 0.001


def test_what_a_vehicle_does_later_is_not_refused() -> None:
    _, config = write_config(survey(seen("auv1/nav", json.dumps({"depth": 3.0, "n": 1}).encode())))
    (stream,) = config.table
    assert stream.type is not None
    for value in ({"depth": 1e6, "n": 1 << 30}, {"depth": -40.0, "n": -7}):
        assert stream.codec.decode(stream.codec.encode(value)) == value


@pytest.mark.parametrize(
    ("key", "priority", "is_reliable"),
    [
        ("auv1/abort", Priority.REAL_TIME, True),
        ("auv1/emergencyStop", Priority.REAL_TIME, True),
        ("auv1/cmd/mode", Priority.INTERACTIVE_HIGH, True),
        ("auv1/nav", Priority.DATA, False),
        ("auv1/battery", Priority.DATA_LOW, False),
        ("auv1/stopwatch", Priority.DATA, False),
    ],
)
def test_words_like_abort_make_a_topic_urgent_and_reliable(
    key: str, priority: Priority, is_reliable: bool
) -> None:
    _, config = write_config(survey(seen(key, b"x")))
    qos = topics_of(config)[key].qos
    assert (qos.priority, qos.reliability is Reliability.RELIABLE) == (priority, is_reliable)


def test_a_topic_keeps_its_period_if_the_channel_has_room_for_it() -> None:
    slow = msgspec.structs.replace(seen("slow", b"x"), period_s=30.02, samples=9)
    fast = msgspec.structs.replace(seen("fast", b"x"), period_s=0.1, samples=99)
    topics = topics_of(write_config(survey(slow, fast))[1])
    assert topics["slow"].qos.min_interval_s == 30.0
    assert topics["fast"].qos.min_interval_s == 5.0
    many = [
        msgspec.structs.replace(seen(f"fast{n}", bytes(40)), period_s=0.1, samples=99)
        for n in range(60)
    ]
    crowded = topics_of(write_config(survey(*many, slow))[1])
    assert crowded["fast1"].qos.min_interval_s > 5 * topics["fast"].qos.min_interval_s
    # It waits with the others, since a period of 30 s is too often then as well.
    assert crowded["slow"].qos.min_interval_s >= 30.0


def test_both_sides_get_the_same_table_and_an_address_of_their_own() -> None:
    files = write_files(
        msgspec.structs.replace(survey(seen("auv1/nav", b"x")), subscribed=("auv1/cmd",)),
        here=Side(address=7, name="auv1", locator="udp/1"),
        there=Side(address=3, name="shore", locator="udp/2"),
        peer=survey(seen("shore/time", b"y")),
    )
    sections = [
        parse_json5(text, source="file")["plugins"]["acoustic"]  # type: ignore[index]
        for text in (files.text, files.peer_text)
    ]
    here, there = (config_from_mapping(each, source="file") for each in sections)
    assert (here.address, there.address) == (7, 3)
    assert here.table.digest == there.table.digest
    assert (here.links[0].locator, there.links[0].locator) == ("udp/1", "udp/2")
    publishers = {name: topic.publishers for name, topic in topics_of(here).items()}
    assert publishers == {"auv1/nav": (7,), "auv1/cmd": (3,), "shore/time": (3,)}
    assert "EDIT:" not in files.text + files.peer_text


@pytest.mark.parametrize(("further", "agreement"), [(3, "confirm"), (4, "tag"), (14, "tag")])
def test_a_fleet_of_six_nodes_and_more_agrees_by_tags(further: int, agreement: str) -> None:
    others = [Side(address=number, name=f"auv{number}") for number in range(3, 3 + further)]
    files = write_files(survey(seen("auv1/nav", b"x")), others=others)
    sections = [
        parse_json5(text, source="file")["plugins"]["acoustic"]  # type: ignore[index]
        for text in (files.text, files.peer_text)
    ]
    here, there = (config_from_mapping(each, source="file") for each in sections)
    for each in (here, there):
        assert len(each.nodes) == 2 + further
        assert each.rules.agreement.value == agreement
    assert here.table.digest == there.table.digest
    config, profile = "fleet.json5", DEFAULT_PROFILE
    scenario = write_traffic(files, here=HERE, there=THERE, others=others, config=config,
                             profile=profile)  # fmt: skip
    whole: Any = parse_json5(scenario, source="scenario")
    assert [each["address"] for each in whole["nodes"]] == [*range(1, 3 + further)]


def test_a_node_that_is_there_twice_is_an_error() -> None:
    with pytest.raises(ConfigError, match="address"):
        write_files(survey(seen("auv1/nav", b"x")), others=[Side(address=2, name="auv2")])


def test_a_field_that_is_missing_at_times_is_optional() -> None:
    assert fields({"a": 1, "b": None}, {"a": 2, "b": 4})["b"]["optional"] is True
    assert fields({"a": 1}, {"a": 2, "b": 4})["b"]["optional"] is True


def test_large_integers_get_a_type_that_holds_them() -> None:
    assert fields({"n": 1 << 40})["n"]["type"] == "int64"
    assert fields({"n": (1 << 64) - 1})["n"]["type"] == "uint64"
    with pytest.raises(NoTypeError):
        fields({"n": 1 << 64})


def test_maps_and_lists_inside_become_types_and_arrays() -> None:
    types = infer_type("Nav", [{"p": {"x": 1}, "legs": [{"n": 1}, {"n": 2}]}])
    assert [each.name for each in types] == ["NavP", "NavLegs", "Nav"]
    assert types[-1].fields[1].keys == {"name": "legs", "type": "NavLegs", "max_length": 4}


@pytest.mark.parametrize(
    "value", [[1], 7, {"a b": 1}, {1: 2}, {"a": [[1]]}, {"a": []}, {"a": ["x"]}, {}]
)
def test_what_has_no_type_is_said_so(value: object) -> None:
    with pytest.raises(NoTypeError):
        infer_type("T", [value])


def test_what_stayed_zero_says_nothing_of_a_step() -> None:
    """A step of 1, from the decimals of zeros, would round all that comes later away."""
    for values in ([0.0, 0.0], [5.0, 5.0], [0.0, 1.0, 2.0]):
        found = fields(*({"q": value} for value in values))["q"]
        assert found.get("step", 0) <= 0.002
    tiny = fields({"q": 0.0}, {"q": 5e-324})["q"]
    assert tiny == {"name": "q", "type": "float64"}
    far = fields(*({"q": value} for value in (1.23456789, 1.3456789, 1.4567891, 1e6)))["q"]
    assert far["step"] <= 0.02


def test_a_list_of_as_many_texts_is_a_fixed_list() -> None:
    """As MAVLink texts are in JSON: fifty letters."""
    found = fields({"t": [*"abc"]}, {"t": ["d", "e", "\x00"]})["t"]
    assert found == {"name": "t", "type": "string", "length": 3, "max_length": 4}
    with pytest.raises(NoTypeError):
        infer_type("T", [{"t": ["a"]}, {"t": ["a", "b"]}])


def dvl(n: int) -> dict[str, Any]:
    beams = [{"id": k, "velocity": 0.01 * k, "distance": 8.0 + n % 3} for k in range(4)]
    return {"vx": 0.5 + 0.01 * n, "covariance": [[1e-7 * n] * 3] * 3, "transducers": beams * 4}


def test_a_device_with_lists_of_lists_leaves_room_to_its_neighbours() -> None:
    """Its payload has no type, so it crosses in parts, five times a second if nobody spaces it."""
    payloads = [json.dumps(dvl(n)).encode() for n in range(40)]
    device = msgspec.structs.replace(
        seen("auv1/dvl", *payloads, encoding="application/json", rate=5.0), period_s=0.2
    )
    small = [
        msgspec.structs.replace(
            seen(f"auv1/{name}", b'{"a": 1}', b'{"a": 2}', encoding="application/json", rate=5.0),
            period_s=0.2, samples=40,
        )
        for name in ("nav", "att")
    ]  # fmt: skip
    files = write_files(survey(device, *small))
    found = topics_of(files.config)
    assert (found["auv1/dvl"].qos.min_interval_s or 0) > 60
    assert (found["auv1/nav"].qos.min_interval_s or 0) < 10
    assert files.text.count("EDIT:") == 1  # the modem
    network = VirtualNetwork(
        Scenario(nodes=tuple(NodeSpec(address=a, position=(200.0 * a, 0, 10)) for a in (1, 2)),
                 channel="none"),
        files.config.table,
    )  # fmt: skip
    values: dict[str, Any] = {"auv1/dvl": payloads[1], "auv1/nav": {"a": 1}, "auv1/att": {"a": 2}}
    for name, value in values.items():
        speak = partial(network.publish, 1, found[name].stream_id, value)
        for n in range(300):
            network.at(n + 1.0, speak)
    network.run(until_s=320)
    arrived = [event.stream_id for event in network.samples(2)]
    assert arrived.count(found["auv1/dvl"].stream_id) >= 1
    for name in ("auv1/nav", "auv1/att"):
        assert arrived.count(found[name].stream_id) >= 30


def test_services_are_of_the_side_that_serves_or_does_not_call_them() -> None:
    own = msgspec.structs.replace(
        survey(seen("auv1/nav", b"x"), services=("auv1/arm",)), called=("shore/time",)
    )
    servers = {
        stream.spec.name: stream.spec.server
        for stream in write_files(own).config.table
        if isinstance(stream.spec, ServiceSpec)
    }
    assert servers == {"auv1/arm": 1, "shore/time": 2}
    peer = survey(seen("shore/x", b"x"), services=("shore/time", "shore/log"))
    servers = {
        stream.spec.name: stream.spec.server
        for stream in write_files(own, peer=peer).config.table
        if isinstance(stream.spec, ServiceSpec)
    }
    assert servers == {"auv1/arm": 1, "shore/time": 2, "shore/log": 2}


def test_what_both_sides_publish_is_of_both() -> None:
    """Two networks that are one are named: there, each topic is on both sides."""
    own, peer = survey(seen("events", b"x")), survey(seen("events", b"y"))
    assert topics_of(write_files(own, peer=peer).config)["events"].publishers == (1, 2)
    one = [msgspec.structs.replace(each, ids=("ab12",)) for each in (own, peer)]
    left_out = write_files(one[0], peer=one[1]).left_out
    assert any("are one network: part their routers" in reason for reason in left_out)


def test_latched_topics_keep_what_they_keep() -> None:
    topic = msgspec.structs.replace(seen("auv1/mode", b"x"), samples=0, rate_hz=0.0, kept=3)
    qos = topics_of(write_config(survey(topic))[1])["auv1/mode"].qos
    assert (qos.durability.value, qos.depth, qos.reliability.value) == (
        "transient_local", 3, "reliable"
    )  # fmt: skip


def test_the_file_is_valid_and_has_every_topic() -> None:
    text, config = write_config(
        survey(
            seen(
                "auv1/nav", cbor2.dumps({"lat": 43.1, "n": 1}), encoding="application/cbor", rate=10
            ),
            seen("auv1/status", json.dumps({"ok": True}).encode()),
            seen("auv1/photo", bytes(range(200)), encoding="image/jpeg"),
            seen("rt/odom", b"\x00\x01\x00\x00" + bytes(50)),
            services=("auv1/arm",),
        )
    )
    topics = topics_of(config)
    assert topics["auv1/nav"].type_name == "Nav"
    assert topics["auv1/nav"].qos.min_interval_s is not None
    assert (topics["auv1/status"].type_name, topics["auv1/status"].encoding) == (
        "Status", "application/json"
    )  # fmt: skip
    assert (topics["auv1/photo"].type_name, topics["auv1/photo"].encoding) == (None, "image/jpeg")
    assert topics["rt/odom"].type_name is None
    assert "looks like CDR" in text
    (service,) = [s.spec for s in config.table if isinstance(s.spec, ServiceSpec)]
    assert service.name == "auv1/arm"
    assert text.count("EDIT:") == 1  # the modem


def test_what_a_router_does_not_tell_is_said() -> None:
    text, _ = write_config(survey(seen("a", b"x"), tells=False))
    assert "this router has no admin space" in text


def test_keys_that_cannot_be_streams_are_left_out_by_name() -> None:
    text, config = write_config(survey(seen("a", b"x"), seen("@adv/x", b"x")))
    assert [stream.name for stream in config.table] == ["a"]
    assert "left out: @adv/x" in text


def test_a_network_without_topics_is_an_error_that_says_what_to_do() -> None:
    with pytest.raises(ConfigError, match="listen longer"):
        write_config(survey())


def test_types_of_equal_chunks_get_different_names() -> None:
    payload = json.dumps({"ok": True}).encode()
    _, config = write_config(survey(*(seen(f"{name}/nav", payload) for name in "abc")))
    assert len({topic.type_name for topic in topics_of(config).values()}) == 3


LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.binary()
VALUES = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(
    st.text(min_size=1, max_size=20),
    st.lists(st.binary(max_size=40) | VALUES.map(cbor2.dumps), min_size=1, max_size=4),
    st.sampled_from(["zenoh/bytes", "application/cbor", "application/json", "\n*/\u2028x"]),
)
def test_whatever_is_published_the_file_is_valid_and_accepts_it(
    key: str, payloads: list[bytes], encoding: str
) -> None:
    anyway = seen("always/there", b"x")
    _, config = write_config(survey(anyway, seen(key, *payloads, encoding=encoding)))
    for stream in config.table:
        if stream.name == key and stream.type is not None:
            for payload in payloads:
                stream.codec.encode(
                    decode_application(payload, stream.encoding, type_spec=stream.type)
                )


@pytest.mark.parametrize("size_bytes", [100, 400, 9000, 500_000])
@pytest.mark.parametrize("is_typed", [False, True])
def test_what_fits_no_frame_is_written_as_reliable_and_crosses(
    size_bytes: int, is_typed: bool, tmp_path: Path
) -> None:
    payload = bytes(range(256)) * (1 + size_bytes // 256)
    payload = payload[:size_bytes]
    if is_typed:
        payload = json.dumps({"text": "x" * (size_bytes - 12)}).encode()
    text, config = write_config(survey(seen("big", payload), seen("small", b"abc")))
    big, small = topics_of(config)["big"], topics_of(config)["small"]
    assert big.qos.reliability is Reliability.RELIABLE
    assert small.qos.reliability is Reliability.BEST_EFFORT
    network = VirtualNetwork(
        Scenario(nodes=tuple(NodeSpec(address=a, position=(200.0 * a, 0, 10)) for a in (1, 2)),
                 channel="none"),
        config.table,
    )  # fmt: skip
    value = {"text": "x" * (size_bytes - 12)} if is_typed else payload
    if size_bytes <= 9000:
        network.at(1, lambda: network.publish(1, big.stream_id, value))
        network.run(until_s=big.qos.lifespan_s or 60)
        assert [event.value for event in network.samples(2)] == [value]
    path = tmp_path / "fleet.json5"
    path.write_text(text, encoding="utf-8")
    assert main(["config", "check", str(path)]) == 0


def test_what_is_larger_than_any_object_is_left_out_with_its_reason() -> None:
    huge = msgspec.structs.replace(seen("huge", b"x"), largest_bytes=2 << 20)
    text, config = write_config(survey(huge, seen("small", b"abc")))
    assert "// left out: huge: 2097152 bytes; allowed: 1048576" in text
    assert list(topics_of(config)) == ["small"]


def test_a_user_who_is_asked_leaves_out_and_slows_down() -> None:
    answers = ["", "n", "what?", "120"]
    asked: list[str] = []

    def ask(question: str) -> str:
        asked.append(question)
        if not answers:
            raise EOFError
        return answers.pop(0)

    topics = [seen(f"auv1/{name}", b"x") for name in ("a", "b", "c", "d", "e")]
    files = write_files(survey(*topics), choose=lambda drafts: ask_about(drafts, ask=ask))
    found = topics_of(files.config)
    assert list(found) == ["auv1/a", "auv1/c", "auv1/d", "auv1/e"]
    assert found["auv1/c"].qos.min_interval_s == 120.0
    assert asked[0].startswith("Enter: as proposed")
    assert "auv1/b" in asked[1]
    with pytest.raises(ConfigError, match="nothing is left"):
        write_files(survey(topics[0]), choose=lambda drafts: [])


def test_a_text_that_grew_by_a_letter_after_the_kept_payloads_still_fits_a_frame() -> None:
    payload = json.dumps({"n": 1, "text": "x" * 40}).encode()
    grown = msgspec.structs.replace(seen("auv1/nav", payload), largest_bytes=len(payload) + 1)
    _, config = write_config(survey(grown))
    assert topics_of(config)["auv1/nav"].qos.reliability is Reliability.BEST_EFFORT


def test_what_ros_publishes_on_the_other_side_is_from_there() -> None:
    """Its keys are not taken for names; a type that both sides publish gets no constants."""
    key = "0/{}/std_msgs::msg::dds_::Bool_/RIHS01_" + BOOL_HASH
    leak = seen(key.format("auv1/leak"), b"\0\1\0\0\0")
    abort = seen(key.format("auv1/abort"), b"\0\1\0\0\1", rate=0.1)
    files = write_files(survey(leak), peer=survey(abort))
    publishers = {
        stream.name: stream.spec.publishers
        for stream in files.config.table
        if isinstance(stream.spec, TopicSpec)
    }
    assert publishers == {"auv1/leak": (1,), "auv1/abort": (2,)}
    both = write_files(survey(leak), peer=survey(leak, abort))
    assert len([*both.config.table]) == 2
    alone = write_files(survey(), peer=survey(abort))
    assert [draft.is_from_peer for draft in alone.drafts] == [True]
    text = write_traffic(both, here=HERE, there=THERE, config="f.json5", profile=DEFAULT_PROFILE)
    assert (
        '{ node: 2, topic: "auv1/abort", every_s: 10, first_s: 0, value: {"data": true} }' in text
    )


@pytest.mark.parametrize("period_s", [5.0, 4.9996, 7.3, 12.34, 60.0, 59.97, 3000.0])
def test_no_interval_is_longer_than_the_period_that_was_measured(period_s: float) -> None:
    """Otherwise each sample waits longer than the one before, until one is left out."""
    topic = msgspec.structs.replace(
        seen("auv1/leak", b"{}", b"{}", encoding="application/json"), period_s=period_s
    )
    (stream,) = write_files(survey(topic)).config.table
    least_s = 5.0 if period_s < 5 else period_s
    assert stream.qos.min_interval_s is not None
    assert 0.9 * period_s <= stream.qos.min_interval_s <= least_s * 1.001


def test_the_traffic_has_no_instants_that_a_person_cannot_read() -> None:
    topic = msgspec.structs.replace(
        seen("auv1/leak", b"{}", b"{}", encoding="application/json"),
        period_s=0.02,
        last_s=7 * 0.02 + 4.1e-5,
    )
    files = write_files(survey(topic))
    text = write_traffic(files, here=HERE, there=THERE, config="f.json5", profile=DEFAULT_PROFILE)
    assert "every_s: 0.02, first_s: 0," in text
