"""Two islands and the water between them, each in processes of its own, on one computer.

The demo starts what a user would start on two computers: a router with a gateway on each island,
and on each island a program that speaks plain Zenoh and knows nothing of sound. Between them is a
water, in real time: the simulator's, or what stands in for another link's. It shows what crosses,
and ends by itself with a verdict: everything that should cross did, or not, and what is missing.

=====================  =============================================================================
`fleet.json5`,         what a user writes: the configuration of the gateways, the water
`water.json5`
`vehicle`, `console`   the two programs; they import nothing of zacoustic
`islands`              a copy of the configuration for each island, with free ports
`waters`               what lies between them, by the name of the link
`children`             processes: started, listened to, stopped whatever happens
`ledgers`              what the gateways publish about themselves
`lanes`, `logbook`     what has happened; `notes`: what is worth telling
`views`, `live`        how it is shown
`verdict`              the summary
`mission`              all of it, from start to end
=====================  =============================================================================
"""
