"""What is done with recordings: looked at, checked, played back, tried in another way, reported.

==============  ====================================================================================
`facts`         what happened, as records; `gathering` out of files; `reactions`: who was asked
`replaying`     engines made again: do they send the same bytes? `otherwise`: with another
                configuration; `playing`: onto a Zenoh network; `epochs` and `frames` in words
`report`        `figures` that all amounts to, as text, plots and page
`whatif`        the load of a trial once more, on `measuredchannel`; `changes`: in another way
`zenohrecord`   a recording of a network, and of gateways that run elsewhere
==============  ====================================================================================
"""
