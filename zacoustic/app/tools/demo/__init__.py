"""Two local networks and a channel, each in separate processes, on one computer.

The demo starts what a user would start on two computers: a router with a gateway on each network,
and on each network a plain Zenoh program that knows nothing of sound. Between them is a
channel in real time: the simulator's, or the stand-in for another link's. It shows what crosses,
and ends by itself with a verdict: whether everything crossed that should, and what is missing.

=====================  =============================================================================
`fleet.json5`,         what a user writes: the configuration of the gateways, the scenario
`medium.json5`
`vehicle`, `console`   the two programs; they import nothing of zacoustic
`networks`              a copy of the configuration for each network, with free ports
`media`               what lies between them, by the name of the link
`children`             processes: started, read, stopped in any case
`ledgers`              what the gateways publish about themselves
`lanes`, `logbook`     what has happened; `notes`: what the demo prints
`views`, `live`        how it is shown
`verdict`              the summary
`mission`              all of it, from start to end
=====================  =============================================================================
"""
