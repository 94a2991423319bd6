"""The table of verbs: which words call which file, under which heading, and what the words were.

A path such as ``topic pub`` names a class of the module `zacoustic.app.cli.<room>.<file>`. Link
packages add theirs through entry points (`zacoustic.app.cli.tree`).
"""

from typing import Final

VERBS: Final = {
    "run gateway": "use.gateway.RunGateway",
    "run demo": "design.demo.Demo",
    "status": "watch.status.Status",
    "nodes": "watch.nodes.Nodes",
    "monitor": "watch.monitor.Monitor",
    "dashboard": "watch.dashboard.Dashboard",
    "topic list": "watch.topics.Topics",
    "topic echo": "use.sub.Echo",
    "topic pub": "use.pub.Pub",
    "topic hz": "use.hz.Hz",
    "topic bw": "watch.bw.Bw",
    "topic info": "watch.info.Info",
    "service list": "watch.topics.Services",
    "service call": "use.call.Call",
    "action list": "watch.topics.Actions",
    "action send_goal": "use.action.SendGoal",
    "ping": "use.ping.PingNode",
    "mavlink vehicle": "use.mavlink.Vehicle",
    "mavlink shore": "use.mavlink.Shore",
    "mavlink streams": "use.mavlink.Streams",
    "stream": "remote.stream.Stream",
    "route show": "remote.route.Show",
    "route probe": "remote.route.Probe",
    "route set": "remote.route.Set",
    "route reset": "remote.route.Reset",
    "silence": "remote.silence.Silence",
    "resume": "remote.resume.Resume",
    "config init": "design.init.Init",
    "config check": "design.check.Check",
    "config plan": "design.plan.Plan",
    "config doctor": "host.doctor.Doctor",
    "config schema": "design.schema.Schema",
    "config show": "design.show.Show",
    "predive": "host.predive.Predive",
    "links": "host.links.Links",
    "sim": "design.sim.Sim",
    "sim campaign": "design.campaign.Campaign",
    "codec fit": "design.fit.Fit",
    "codec bench": "design.bench.Bench",
    "record": "recordings.record.Record",
    "replay": "recordings.replay.Replay",
    "report": "recordings.report.Report",
    "decode": "recordings.decode.Decode",
    "journal": "recordings.journal.Journal",
    "audit": "security.audit.Audit",
    "key new": "security.key.New",
    "key show": "security.key.Show",
    "key rotate": "security.key.Rotate",
    "key revoke": "security.key.Revoke",
    "key rejoin": "security.key.Rejoin",
    "key check": "security.key.Check",
    "key send": "security.key.Send",
    "acl": "security.acl.Acl",
    "completion": "host.completion.Completion",
}
"""Room, file and class of each of our verbs, in the order of the help."""

GROUPS: Final = {
    "run": "what runs until Ctrl-C",
    "run modems": "emulated modems, for tests without hardware",
    "topic": "what is published",
    "service": "what can be called",
    "action": "what can be commanded and takes its time",
    "route": "the routes over relays, and which would be best",
    "mavlink": "join an autopilot to a ground station",
    "config": "the file of a fleet",
    "key": "the key that seals frames",
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
