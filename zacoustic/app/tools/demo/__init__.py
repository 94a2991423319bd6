"""Two local networks and a channel, each in separate processes, on one computer.

The demo starts the programs that a user would start on two computers: on each network a router with
a gateway, and a plain Zenoh program that knows nothing of sound. Between them is a channel in real
time: the simulator's, or the stand-in of another link. The demo shows what crosses, and ends by
itself with a verdict: whether everything crossed that should, and what is missing.

=====================  =============================================================================
`fleet.json5`,         files as a user writes them: the configuration of the gateways, the scenario
`medium.json5`
`vehicle`, `console`   the two programs; they import nothing of zacoustic
`networks`              a copy of the configuration for each network, with free ports
`media`               the process of the channel, by the name of the link
`children`             processes: started, read, stopped in any case
`ledgers`              the gateways' reports about themselves
`lanes`, `logbook`     what has happened; `notes`: lines that the demo prints
`views`, `live`        how it is shown
`verdict`              the summary
`mission`              all of it, from start to end
=====================  =============================================================================
"""
