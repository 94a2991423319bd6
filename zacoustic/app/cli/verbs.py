"""The table of verbs: which words call which file, under which heading, and what the words were.

A path such as ``topic pub`` names the module `zacoustic.app.cli.<room>.<file>`, whose class is
`<File>Command`. Link packages add theirs through entry points (`zacoustic.app.cli.tree`).
"""

from typing import Final

VERBS: Final = {
    "run gateway": "use.gateway",
    "run demo": "design.demo",
    "status": "watch.status",
    "nodes": "watch.nodes",
    "monitor": "watch.monitor",
    "dashboard": "watch.dashboard",
    "topic list": "watch.topics",
    "topic echo": "use.sub",
    "topic pub": "use.pub",
    "topic hz": "use.hz",
    "topic bw": "watch.bw",
    "topic info": "watch.info",
    "service list": "watch.services",
    "service call": "use.call",
    "action list": "watch.actions",
    "action send_goal": "use.action",
    "ping": "use.ping",
    "mavlink": "use.mavlink",
    "stream": "remote.stream",
    "route": "remote.route",
    "silence": "remote.silence",
    "resume": "remote.resume",
    "config init": "design.init",
    "config check": "design.check",
    "config plan": "design.plan",
    "config doctor": "host.doctor",
    "config schema": "design.schema",
    "config show": "design.show",
    "predive": "host.predive",
    "links": "host.links",
    "sim": "design.sim",
    "sim campaign": "design.campaign",
    "codec fit": "design.fit",
    "codec bench": "design.bench",
    "record": "recordings.record",
    "replay": "recordings.replay",
    "report": "recordings.report",
    "decode": "recordings.decode",
    "journal": "recordings.journal",
    "audit": "security.audit",
    "key": "security.key",
    "acl": "security.acl",
    "completion": "host.completion",
}
"""Room and file of each of our verbs, in the order of the help."""

GROUPS: Final = {
    "run": "what runs until Ctrl-C",
    "run modems": "emulated modems, for tests without hardware",
    "topic": "what is published",
    "service": "what can be called",
    "action": "what can be commanded and takes its time",
    "config": "the file of a fleet",
    "codec": "models of the dense codec, and what each codec costs",
}
"""What the members of a group are about."""

HEADINGS: Final = {
    "run and watch": ("run", "status", "nodes", "monitor", "dashboard"),
    "use": ("topic", "service", "action", "ping", "mavlink"),
    "command other nodes": ("stream", "route", "silence", "resume"),
    "prepare": ("config", "predive", "links", "sim", "codec"),
    "record and explain": ("record", "replay", "report", "decode", "journal", "audit"),
    "secure": ("key", "acl"),
    "this shell": ("completion",),
}
"""First words under each heading of the help."""

ALIASES: Final = {
    "gateway": "run gateway",
    "medium": "run medium",
    "emulate": "run modems",
    "demo": "run demo",
    "pub": "topic pub",
    "sub": "topic echo",
    "topics": "topic list --wide",
    "call": "service call",
    "init": "config init",
    "check": "config check",
    "plan": "config plan",
    "doctor": "config doctor",
    "schema": "config schema",
    "fit": "codec fit",
    "bench telemetry": "codec bench",
    "bench": "codec bench",
}
"""What the words of earlier versions, and of entry points of link packages, mean now."""
