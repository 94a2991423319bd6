"""Permissions as Zenoh's `access_control`, and the settings by which a router identifies clients.

A rule of Zenoh allows or denies messages of some kinds, to the router (ingress) or from it
(egress), whose key it covers; a denial precedes a permission. Everything else is denied. Actions
reserved for gateways are expressly denied to programs, because key expressions of streams may
overlap. A denial of ``auv1/nav`` does not cover a put on ``auv1/*``, which a subscriber of the
first receives too; so nothing wider can be opened to programs.
"""

import json
from enum import Enum
from typing import Any, Final

import msgspec
import zenoh

from zacoustic.app.tools.security.access.grants import (
    Act,
    Grant,
    Role,
    exclusive_of,
    grants_of,
)
from zacoustic.config import Config
from zacoustic.errors import ConfigError

_INGRESS: Final = {
    Act.PUBLISH: ("put", "delete"),
    Act.SUBSCRIBE: ("declare_subscriber",),
    Act.ASK: ("query",),
    Act.ANSWER: ("declare_queryable", "reply"),
    Act.APPEAR: ("liveliness_token",),
    Act.WATCH: ("declare_liveliness_subscriber", "liveliness_query"),
}
"""Messages that a client sends for an action."""
_EGRESS: Final = {
    Act.PUBLISH: ("declare_subscriber",),
    Act.SUBSCRIBE: ("put", "delete"),
    Act.ASK: ("declare_queryable", "reply"),
    Act.ANSWER: ("query",),
    Act.APPEAR: ("declare_liveliness_subscriber", "liveliness_query"),
    Act.WATCH: ("liveliness_token",),
}
"""Messages that the router sends to that client for it."""
_OPENED: Final = (Act.PUBLISH, Act.SUBSCRIBE, Act.ASK, Act.ANSWER)
_TLS: Final = {
    "root_ca_certificate": "ca.pem",
    "listen_certificate": "router.pem",
    "listen_private_key": "router.key",
    "enable_mtls": True,
}


class KnownBy(Enum):
    """How a router identifies its clients."""

    CERTIFICATES = "certificates"
    """The common names of their certificates: TLS."""
    USERS = "users"
    """User name and password."""
    INTERFACES = "interfaces"
    """The network interface of the router that they use."""


_SUBJECT: Final = {
    KnownBy.CERTIFICATES: "cert_common_names",
    KnownBy.USERS: "usernames",
    KnownBy.INTERFACES: "interfaces",
}


class Names(msgspec.Struct, frozen=True, kw_only=True):
    """The names of the groups."""

    by: KnownBy = KnownBy.CERTIFICATES
    """Kind of the names."""
    programs: tuple[str, ...] = ()
    """Programs; none: all clients."""
    operators: tuple[str, ...] = ()
    """Operators; none: all programs."""
    gateways: tuple[str, ...] = ()
    """Gateways that are clients of the router."""


def access_settings(
    config: Config, names: Names, *, beside: tuple[int, ...] = (), opened: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return settings for the file of a router.

    Args:
        config: Configuration of the node on its network.
        names: The names of the groups.
        beside: Addresses of other nodes on the same network.
        opened: Additional key expressions for programs.

    Raises:
        ConfigError: Gateways are named and programs are not; the gateway is not a router, and has
            no name; or an opened expression covers a key of a remote node.
    """
    _check(config, names)
    grants = grants_of(config, beside)
    alone = exclusive_of(config, grants)
    for key in opened:
        _check_opened(key, alone)
        grants += tuple(Grant(Role.PROGRAM, act, key) for act in _OPENED)
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for role in Role:
        own = [grant for grant in grants if grant.role is role]
        if role is Role.GATEWAY and not names.gateways:
            continue
        ids = _add_rules(rules, f"{role.value} may ", "allow", own, both=True)
        subjects = _subjects_of(role, names)
        policies.append({"rules": ids, "subjects": subjects})
    ids = _add_rules(rules, "programs may not ", "deny", list(alone), both=False)
    who = [Role.PROGRAM.value, *([Role.OPERATOR.value] if names.operators else [])]
    policies.append({"rules": ids, "subjects": who})
    return {
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": rules,
            "subjects": _subjects(names),
            "policies": policies,
        },
        **_identities(names),
    }


def as_text(settings: dict[str, Any]) -> str:
    """Return the settings as JSON5, to be merged into those of the router."""
    body = json.dumps(settings, indent=2, ensure_ascii=False)
    return "// For the file of the router, beside `mode` and `plugins`.\n" + body


def _check(config: Config, names: Names) -> None:
    if names.gateways and not names.programs:
        raise ConfigError(
            "--gateway without --program; allowed: both",
            hint="a gateway that is known as anybody would be denied what anybody is",
        )
    mode = "router"
    if config.zenoh_config is not None:
        mode = json.loads(config.zenoh_config.get_json("mode")) or "peer"
    if mode != "router" and not names.gateways:
        raise ConfigError(
            f'{config.source}: mode: "{mode}", and --gateway is missing; allowed: the name by '
            "which the router knows the gateway",
            hint="only a gateway that is the router itself needs no name",
        )


def _check_opened(key: str, alone: tuple[Grant, ...]) -> None:
    try:
        expression = zenoh.KeyExpr(key)
    except zenoh.ZError as error:
        raise ConfigError(f"--open {key}; allowed: a key expression of Zenoh") from error
    for grant in alone:
        if expression.intersects(zenoh.KeyExpr(grant.key)):
            raise ConfigError(
                f"--open {key} covers {grant.key}, where gateways alone {grant.act.value}; "
                "allowed: keys of programs only",
                hint="name them one by one",
            )


def _add_rules(
    rules: list[dict[str, Any]], title: str, permission: str, grants: list[Grant], *, both: bool
) -> list[str]:
    """Add a rule for each act and direction; return their ids."""
    ids = []
    for act in Act:
        keys = [grant.key for grant in grants if grant.act is act]
        flows = [("ingress", _INGRESS[act])]
        flows += [("egress", _EGRESS[act])] if both else []
        for flow, messages in flows if keys else ():
            ids.append(f"{title}{act.value}: {flow}")
            rules.append(
                {
                    "id": ids[-1],
                    "permission": permission,
                    "flows": [flow],
                    "messages": list(messages),
                    "key_exprs": keys,
                }
            )
    return ids


def _subjects_of(role: Role, names: Names) -> list[str]:
    """Return the clients with the permissions of a role: operators have those of programs."""
    match role:
        case Role.PROGRAM:
            return [role.value, *([Role.OPERATOR.value] if names.operators else [])]
        case Role.OPERATOR:
            return [role.value if names.operators else Role.PROGRAM.value]
        case Role.GATEWAY:
            return [role.value]


def _subjects(names: Names) -> list[dict[str, Any]]:
    known = {
        Role.PROGRAM: names.programs,
        Role.OPERATOR: names.operators,
        Role.GATEWAY: names.gateways,
    }
    return [
        {"id": role.value, **({_SUBJECT[names.by]: list(who)} if who else {})}
        for role, who in known.items()
        if who or role is Role.PROGRAM
    ]


def _identities(names: Names) -> dict[str, Any]:
    """Return the settings by which the router learns names; the user makes files and passwords."""
    match names.by:
        case KnownBy.CERTIFICATES:
            return {"transport": {"link": {"tls": _TLS}}}
        case KnownBy.USERS:
            return {"transport": {"auth": {"usrpwd": {"dictionary_file": "users.txt"}}}}
        case KnownBy.INTERFACES:
            return {}
