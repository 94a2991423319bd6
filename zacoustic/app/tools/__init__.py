"""What the verbs of the command line do, as functions and records; the verbs themselves only print.

=============  =====================================================================================
`design`       before the fleet is at sea. `check`: a configuration as a table, `plan`: does the
               traffic fit the channel, `sim`: a scenario in virtual time, `first`: a first
               configuration from a live network, `telemetry`: models of recorded telemetry,
               `reference`: every key of the configuration
`field`        at the modems. `doctor`: what will go wrong at sea, and its cure; `pinging`,
               `following`, `commands` ask gateways, `links` lists the installed ones
`watch`        the health reports of gateways
`inspect`      afterwards. `decode`: frames in words; `recordings`: contents, replay, what-if
`demo`         two local networks and a channel, in separate processes
`pages`        what pages for a browser have in common
=============  =====================================================================================

Beside them: `fleetfile` and `fleets` make the nodes of a file or a scenario, `crossing` says what
can cross at all, `columns` writes tables.
"""
