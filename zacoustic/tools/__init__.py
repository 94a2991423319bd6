"""What the verbs of the command line do, as functions and records; the verbs themselves only print.

=============  =====================================================================================
`check`        a configuration as a table: bytes and airtime of every stream
`plan`         does what is to be said fit the channel?
`doctor`       what will go wrong at sea, and its cure
`decode`       frames in words
`sim`          a scenario with its traffic, in virtual time
`first`        what a live Zenoh network carries, and the first configuration for it
`telemetry`    recorded telemetry: models of it, and its bytes in every codec
`recordings`   recordings of runs: what was in them, again, and otherwise
`watch`        what gateways tell of themselves
`reference`    every key of the configuration
`demo`         two islands and the water between them, in processes of their own
=============  =====================================================================================

Beside them: `pinging`, `following` and `orders` ask gateways, `links` tells which are installed,
`fleets` who is in a scenario; `columns` and `jsonlog` write text.
"""
