"""What the verbs of the command line do, as functions and records; the verbs themselves only print.

=============  =====================================================================================
`check`        a configuration as a table: bytes and airtime of every stream
`decode`       the records of a frame in words
`simulation`   a scenario with its traffic, in virtual time
`first`        what a live Zenoh network carries, and the first configuration for it
`pinging`      pings, and what came of them
`watch`        what gateways tell of themselves
`demo`         two islands and the water between them, in processes of their own
=============  =====================================================================================

`checktext`, `simulationtext`, `links` and `columns` make texts for people of what those return.
"""
