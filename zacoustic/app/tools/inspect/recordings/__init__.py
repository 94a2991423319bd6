"""Uses of recordings: inspection, check, replay, what-if, report.

==============  ====================================================================================
`facts`         events as records; `gathering` reads them; `reactions`: answers of programs
`replaying`     engines made again: do they send the same bytes? `otherwise`: with another
                configuration; `playing`: onto a Zenoh network; `frames` in words
`report`        `figures` of a recording, as text, plots and page
`whatif`        the load of a trial again, on `measuredchannel`; `changes`: with changes
`zenohrecord`   a recording of a network, and of gateways that run elsewhere
==============  ====================================================================================
"""
