import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.channel.medium import Medium
from zacoustic.channel.scenario import NodeSpec, Scenario, scenario_from_mapping
from zacoustic.errors import ConfigError

HERE = [0, 0, 0]
NODES: list[dict[str, Any]] = [
    {"address": 1, "position": HERE},
    {"address": 2, "position": [1000, 0, 50]},
]


def _parse(mapping: object) -> Scenario:
    return scenario_from_mapping(mapping, source="fleet.json5")


def test_a_scenario_has_defaults_for_all_but_its_nodes() -> None:
    scenario = _parse({"nodes": NODES})
    assert (scenario.channel, scenario.collisions) == ("sea", "capture")
    assert scenario.profile == "evologics_s2c_18_34"
    assert (scenario.sound_speed_m_s, scenario.wind_m_s, scenario.shipping) == (1500.0, 5.0, 0.5)
    assert (scenario.seed, scenario.loss.frame, scenario.links) == (1, 0.0, ())
    assert scenario.nodes[1].position == (1000.0, 0.0, 50.0)


def test_a_scenario_takes_everything_that_the_format_has() -> None:
    track = [{"t": 0, "position": HERE}, {"t": 600.5, "position": [100, 0, 0]}]
    scenario = _parse(
        {
            "seed": 7,
            "sound_speed_m_s": 1490,
            "wind_m_s": 8.5,
            "shipping": 0.9,
            "profile": "janus",
            "channel": "awgn",
            "collisions": "sinr",
            "nodes": [
                {"address": 1, "name": "shore", "position": HERE, "profile": "ahoi"},
                {"address": 254, "track": track},
            ],
            "loss": {"frame": 0.1, "burst_frames": 4},
            "links": [{"from": 1, "to": 254, "loss": {"frame": 0.3}}],
            "faults": {
                "corrupt": 0.01,
                "duplicate": 0.02,
                "duplicate_after_s": [1, 2],
                "jitter_s": 0.1,
                "blackouts": [{"pair": [1, 254], "from_s": 5, "to_s": 9, "every_s": 60}],
                "unplugged": [{"node": 1, "from_s": 5, "to_s": 9}],
                "crashes": [{"node": 1, "at_s": [7]}, {"node": 254, "every_s": 600}],
                "clocks": [{"node": 1, "drift_ppm": 5, "jumps": [{"at_s": 9, "by_s": -1e8}]}],
                "journal": {"commit_s": 0.1, "fails": [{"node": 1, "from_s": 1, "to_s": 2}]},
                "until_s": 3600,
            },
        }
    )
    assert [scenario.profile_of(node) for node in scenario.nodes] == ["ahoi", "janus"]
    assert scenario.loss_between(1, 254).frame == 0.3
    assert scenario.loss_between(254, 1).burst_frames == 4
    assert scenario.nodes[1].motion().position(600.5) == (100.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wind": 5}, r"wind is no key; allowed: nodes, seed, sound_speed_m_s, .*faults"),
        ({"nodes": [{"adress": 1}]}, r"nodes\[0\].adress is no key; allowed: address, name, "),
        ({"loss": {"frames": 1}}, r"loss.frames is no key; allowed: frame, burst_frames"),
        ({"faults": {"crash": 1}}, r"faults.crash is no key; allowed: corrupt, .*crashes"),
        (
            {"faults": {"crashes": [{"node": 9, "at_s": [1]}]}},
            r"faults.crashes\[0\].node is 9; allowed: the address of a node",
        ),
        (
            {"faults": {"blackouts": [{"pair": [1, 9], "from_s": 0, "to_s": 1}]}},
            r"faults.blackouts\[0\].pair is 9; allowed: the address of a node",
        ),
        ({"faults": {"crashes": [{"node": 1}]}}, r"faults.crashes\[0\].at_s is missing; .* one of"),
        (
            {"faults": {"crashes": [{"node": 1, "at_s": [-1]}]}},
            r"faults.crashes\[0\].at_s\[0\] is -1.0; allowed",
        ),
        (
            {"faults": {"clocks": [{"node": 1}, {"node": 1}]}},
            r"faults.clocks\[1\].node is 1; allowed: each node once",
        ),
        ({"faults": {"journal": {"untold": 2}}}, r"faults.journal.untold is 2.0; allowed: 0"),
        (
            {"traffic": [{"node": 1, "topic": "a", "every_s": 1, "size_bytes": [9, 3]}]},
            r"traffic\[0\].size_bytes\[1\] is 3; allowed",
        ),
        (
            {"traffic": [{"node": 1, "topic": "a", "every_s": 1, "pattern": "odd"}]},
            r"traffic\[0\].pattern is 'odd'; allowed: periodic, random",
        ),
        ({"nodes": []}, r"nodes is empty; allowed: at least one node"),
        ({"nodes": {"a": 1}}, r"nodes is {'a': 1}; allowed: a list of { address, … }"),
        ({"nodes": [{"position": HERE}]}, r"nodes\[0\].address is missing"),
        ({"nodes": [NODES[0], NODES[0]]}, r"nodes\[1\].address is 1; allowed: an address that "),
        ({"nodes": [{"address": 0, "position": HERE}]}, r"nodes\[0\].address is 0; .* 1..254"),
        ({"nodes": [{"address": 255, "position": HERE}]}, r"nodes\[0\].address is 255; .*1..254"),
        (
            {"nodes": [{"address": "1", "position": HERE}]},
            r"nodes\[0\].address is '1'; .* a whole number",
        ),
        ({"nodes": [{"address": 1}]}, r"nodes\[0\].position is missing; .* position and track"),
        (
            {"nodes": [{"address": 1, "position": HERE, "track": []}]},
            r"nodes\[0\].track is given beside position; allowed: exactly one",
        ),
        ({"nodes": [{"address": 1, "track": []}]}, r"nodes\[0\].track is \[\]; .*at least one"),
        (
            {"nodes": [{"address": 1, "position": [1, 2]}]},
            r"nodes\[0\].position is \[1, 2\]; allowed: a list of 3 values",
        ),
        (
            {"nodes": [{"address": 1, "position": [1, 2, math.inf]}]},
            r"nodes\[0\].position\[2\] is inf; allowed: -1e\+06..1e\+06",
        ),
        (
            {"nodes": [{"address": 1, "position": [1, 2, 10**400]}]},
            r"nodes\[0\].position\[2\] is 1000.*; allowed: a number that a float can hold",
        ),
        ({"nodes": [{"address": 1, "position": HERE, "profile": "x"}]}, r"profile is 'x'; .*ahoi"),
        ({"profile": "s2c"}, r"profile is 's2c'; allowed: ahoi, evologics_s2c_18_34, .*nanomodem"),
        ({"channel": "air"}, r"channel is 'air'; allowed: awgn, desert, none, recorded, sea"),
        ({"collisions": "no"}, r"collisions is 'no'; allowed: capture, protocol, sinr"),
        ({"seed": 1.5}, r"seed is 1.5; allowed: a whole number"),
        ({"sound_speed_m_s": 0}, r"sound_speed_m_s is 0.0; allowed: 1000..2000"),
        ({"wind_m_s": -1}, r"wind_m_s is -1.0; allowed: 0..60"),
        ({"shipping": math.nan}, r"shipping is nan; allowed: 0..1"),
        ({"loss": {"frame": 1.5}}, r"loss.frame is 1.5; allowed: 0..1"),
        ({"loss": {"frame": 0.9, "burst_frames": 2}}, r"loss.burst_frames is 2.0; .* at least"),
        ({"faults": {"corrupt": 2}}, r"faults.corrupt is 2.0; allowed: 0..1"),
        (
            {"links": [{"from": 1, "to": 3, "loss": {}}]},
            r"links\[0\].to is 3; allowed: the address of a node",
        ),
        (
            {"links": [{"from": 1, "to": 1, "loss": {}}]},
            r"links\[0\].to is 1; allowed: another node",
        ),
        (
            {"links": [{"from": 1, "to": 2, "loss": {}}] * 2},
            r"links\[1\].to is 2; allowed: each direction once",
        ),
        (
            {"links": [{"source": 1, "to": 2, "loss": {}}]},
            r"links\[0\].source is no key; allowed: from, to, loss",
        ),
        ({5: 1}, r"the scenario has a key that is no string"),
        ({"two\nlines": 1}, r"'two\\nlines' is no key"),
    ],
)
def test_a_wrong_scenario_is_one_line_with_file_key_value_and_what_is_allowed(
    change: dict[Any, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=rf"^fleet\.json5: .*{message}") as caught:
        _parse({"nodes": NODES, **change})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("track", "message"),
    [
        ([(0, HERE), (0, HERE)], r"track\[1\].t is 0.0; allowed: above track\[0\].t, 0.0"),
        ([(5, HERE), (4, HERE)], r"track\[1\].t is 4.0; allowed: above track\[0\].t, 5.0"),
        ([(0, HERE), (1, [500, 0, 0])], r"track\[1\].t is 1.0, which makes 500 m/s"),
        ([(math.nan, HERE)], r"track\[0\].t is nan"),
        ([(0, [math.nan, 0, 0])], r"track\[0\].position\[0\] is nan"),
    ],
)
def test_a_wrong_track_is_an_error(track: list[tuple[float, list[float]]], message: str) -> None:
    waypoints = [{"t": t, "position": position} for t, position in track]
    with pytest.raises(ConfigError, match=rf"nodes\[0\]\.{message}"):
        _parse({"nodes": [{"address": 1, "track": waypoints}]})


@pytest.mark.parametrize("mapping", [None, 5, "text", [], [NODES]])
def test_what_is_no_mapping_is_an_error(mapping: object) -> None:
    with pytest.raises(ConfigError, match=r"the scenario is .*; allowed: { nodes, seed, "):
        _parse(mapping)


def test_records_made_from_python_are_checked_too() -> None:
    with pytest.raises(ValueError, match="address is 300"):
        NodeSpec(address=300, position=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="nodes is empty"):
        Scenario(nodes=())


_leaves = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=4)
)
_WORDS = [
    "nodes",
    "seed",
    "sound_speed_m_s",
    "wind_m_s",
    "shipping",
    "profile",
    "channel",
    "collisions",
    "loss",
    "links",
    "faults",
    "address",
    "name",
    "position",
    "track",
    "t",
    "frame",
    "burst_frames",
    "from",
    "to",
    "corrupt",
    "duplicate",
    "duplicate_after_s",
]
_keys = st.sampled_from(_WORDS) | st.text(max_size=5)
_anything = st.recursive(
    _leaves,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_keys, inner, max_size=5),
    max_leaves=20,
)


@given(_anything)
def test_any_value_is_a_scenario_or_a_config_error(mapping: object) -> None:
    try:
        scenario = _parse(mapping)
    except ConfigError as error:
        message = str(error)
    else:
        assert isinstance(scenario, Scenario)
        return
    assert message.startswith("fleet.json5: ")
    assert len(message.splitlines()) == 1


_numbers = st.floats() | st.integers(-3, 3000) | st.just(0.5)
_plausible = st.fixed_dictionaries(
    {
        "nodes": st.lists(
            st.fixed_dictionaries(
                {"address": st.integers(0, 256)},
                optional={
                    "position": st.lists(_numbers, min_size=3, max_size=3),
                    "track": st.lists(
                        st.fixed_dictionaries(
                            {
                                "t": _numbers,
                                "position": st.lists(_numbers, min_size=3, max_size=3),
                            }
                        ),
                        max_size=3,
                    ),
                    "profile": st.sampled_from(["ideal", "janus", "ahoi", "x"]),
                },
            ),
            max_size=3,
        )
    },
    optional={
        "channel": st.sampled_from(["sea", "awgn", "none", "desert"]),
        "collisions": st.sampled_from(["capture", "protocol", "sinr"]),
        "loss": st.fixed_dictionaries({}, optional={"frame": _numbers, "burst_frames": _numbers}),
        "faults": st.fixed_dictionaries({}, optional={"corrupt": _numbers}),
        "seed": st.integers(),
        "wind_m_s": _numbers,
    },
)


@given(_plausible)
def test_every_scenario_that_parses_makes_a_medium_that_works(mapping: dict[str, Any]) -> None:
    try:
        scenario = _parse(mapping)
    except ConfigError:
        return
    medium = Medium(scenario)
    for address in medium.addresses:
        emission = medium.transmit(address, 8, 0)
        for arrival in emission.arrivals:
            assert arrival.ends_at > arrival.starts_at >= 0
            medium.finish(arrival)
