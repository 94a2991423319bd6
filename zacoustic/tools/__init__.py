"""What the verbs of the command line do, as functions and records; the verbs themselves only print.

=============  =====================================================================================
`check`        a configuration as a table: bytes and airtime of every stream
`plan`         does the traffic fit the channel?
`doctor`       what will go wrong at sea, and its cure
`decode`       frames in words
`sim`          a scenario with its traffic, in virtual time
`first`        what a live Zenoh network carries, and the first configuration for it
`telemetry`    recorded telemetry: models of it, and its bytes in every codec
`recordings`   recordings of runs: contents, replay, what-if
`watch`        the health reports of gateways
`reference`    every key of the configuration
`demo`         two local networks and a channel, in separate processes
=============  =====================================================================================

Beside them: `pinging`, `following` and `orders` ask gateways, `links` lists the installed ones,
`fleets` makes the nodes of a scenario; `columns` and `jsonlog` write text.
"""
