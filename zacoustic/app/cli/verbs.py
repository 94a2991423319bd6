"""The table of verbs: which words call which file, under which heading, and what the words were.

A path such as ``topic pub`` names a class of the module `zacoustic.app.cli.<room>.<file>`. Link
packages add theirs through entry points (`zacoustic.app.cli.tree`).
"""

from typing import Final

VERBS: Final = {
    "run gateway": "use.gateway.RunGateway",
    "run demo": "design.demo.DemoCommand",
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
    "config init": "design.init.InitCommand",
    "config check": "design.check.CheckCommand",
    "config plan": "design.plan.PlanCommand",
    "config doctor": "host.doctor.DoctorCommand",
    "config schema": "design.schema.SchemaCommand",
    "config show": "design.show.ShowCommand",
    "predive": "host.predive.PrediveCommand",
    "links": "host.links.LinksCommand",
    "sim": "design.sim.SimCommand",
    "sim campaign": "design.campaign.CampaignCommand",
    "codec fit": "design.fit.FitCommand",
    "codec bench": "design.bench.BenchCommand",
    "record": "recordings.record.RecordCommand",
    "replay": "recordings.replay.ReplayCommand",
    "report": "recordings.report.ReportCommand",
    "decode": "recordings.decode.DecodeCommand",
    "journal": "recordings.journal.JournalCommand",
    "audit": "security.audit.AuditCommand",
    "key": "security.key.KeyCommand",
    "acl": "security.acl.AclCommand",
    "completion": "host.completion.CompletionCommand",
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
