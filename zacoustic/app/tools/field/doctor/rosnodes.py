"""The ROS 2 nodes of the local network against the file: domain, types, and whether they are met.

rmw_zenoh puts domain, type and hash of the type into each key: where one differs, two nodes on one
network never hear each other, and nothing says so.
"""

from collections.abc import Iterator, Sequence
from typing import Final

from zacoustic.app.tools.field.doctor.network import Running
from zacoustic.config import Config
from zacoustic.config.ros import RosConfig
from zacoustic.link.contract import Finding
from zacoustic.ros.names import NO_HASH, RosKey, interface_of
from zacoustic.ros.streams import RosService, RosTopic
from zacoustic.ros.tokens import Entity, Token, read_token

_GATEWAY: Final = "acoustic_gateway_"
_SHOWN: Final = 3


def judge_nodes(config: Config, running: Running) -> Iterator[Finding]:
    """Find what keeps the gateway and the nodes of ROS 2 on its network from each other."""
    tokens = [token for each in running.tokens if (token := read_token(each)) is not None]
    tokens = [token for token in tokens if not token.node.name.startswith(_GATEWAY)]
    unmet = [token for each in running.unmet if (token := read_token(each)) is not None]
    unmet = [token for token in unmet if not token.node.name.startswith(_GATEWAY)]
    if unmet:
        yield Finding(
            what=f"a peer without gossip does not meet the nodes of its router: {_nodes(unmet)}",
            why="the router leaves peers to each other, and nothing tells the gateway where they "
            "are: nothing of them crosses",
            cure='mode: "client" in the file, or scouting: { gossip: { enabled: true } }',
        )
    ros = config.ros
    if ros is None or not tokens:
        return
    domain = ros.domain
    if all(token.node.domain != domain for token in tokens):
        found = sorted({token.node.domain for token in tokens})
        yield Finding(
            what=f"no node of ROS 2 is in domain {domain}; here they are in "
            f"{', '.join(map(str, found))}: {_nodes(tokens)}",
            why="the domain is in each key: the gateway hears nothing of them, nor they of it",
            cure=f"ros: {{ domain: {found[0]} }} in the file, or the same ROS_DOMAIN_ID for all",
        )
        return
    yield from _types(config, ros, [token for token in tokens if token.node.domain == domain])


def _types(config: Config, ros: RosConfig, tokens: Sequence[Token]) -> Iterator[Finding]:
    """Find topics and services that nodes have with another type, or another one of that name."""
    wanted: dict[str, RosKey] = {}
    for stream_id, stream in ros.streams.items():
        name = config.table.by_id(stream_id).name
        if isinstance(stream, RosTopic | RosService):
            wanted[f"/{name}"] = stream.key(ros.domain, name)
    told: set[str] = set()
    old: list[Token] = []
    for token in tokens:
        expected = wanted.get(token.topic)
        if expected is None or token.kind is Entity.NODE or token.topic in told:
            continue
        if token.type != expected.type:
            told.add(token.topic)
            yield Finding(
                what=f"{token.topic} is {interface_of(token.type)} at {token.full_node_name}, and "
                f"{interface_of(expected.type)} in the file",
                why="the type is in the key: nothing of it crosses",
                cure="write the type of the node",
            )
        elif token.hash != expected.hash and NO_HASH in (token.hash, expected.hash):
            old.append(token)
        elif token.hash != expected.hash:
            told.add(token.topic)
            yield Finding(
                what=f"{token.topic}: {token.full_node_name} has another definition of "
                f"{interface_of(expected.type)} than the file: its hash differs",
                why="the hash is in the key: nothing of it crosses",
                cure="name the folder of its package: ros: { packages: FOLDER }; or its "
                "distribution: ros: { distro: … }",
            )
    if old:
        has_hash = old[0].hash != NO_HASH
        there = "a later distribution than Humble" if has_hash else "Humble"
        yield Finding(
            what=f"the nodes are of {there}, and the file has distro {ros.distro}: {_nodes(old)}",
            why="keys of Humble have no hash of the type, all later ones do: nothing crosses",
            cure=f'ros: {{ distro: "{"jazzy" if has_hash else "humble"}" }} in the file',
        )


def _nodes(tokens: Sequence[Token]) -> str:
    names = sorted({token.full_node_name for token in tokens})
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
