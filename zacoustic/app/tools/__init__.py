"""The work of the command line's verbs, as functions and records; the verbs only print.

=============  =====================================================================================
`design`       before deployment. `check`: a configuration as a table, `plan`: whether the traffic
               fits the channel, `sim`: a scenario in virtual time, `first`: a first configuration
               from a live network, `telemetry`: models of recorded telemetry, `reference`: every
               key of the configuration
`field`        at the modems. `doctor`: faults to expect at sea, and their cures; `pinging`,
               `following`, `commands` ask gateways, `links` lists the installed ones
`watch`        the health reports of gateways
`inspect`      after a mission. `decode`: frames in words; `recordings`: contents, replay, what-if
`demo`         two local networks and a channel, in separate processes
`pages`        common parts of pages for a browser
=============  =====================================================================================

Besides: `fleetfile` and `fleets` make the nodes of a file or a scenario, `crossing` tells what can
cross at all, `columns` formats tables.
"""
