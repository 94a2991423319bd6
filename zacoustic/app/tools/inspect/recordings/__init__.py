"""What is done with recordings: looked at, checked, played back, tried in another way, reported.

===============  ===================================================================================
`epochs`          the boot epochs of nodes in a file, with their calls; a call made again
`checking`       engines made again: do they send the same bytes? (`checktext`)
`otherwise`      the same inputs into engines of another configuration (`today`)
`frames`         frames in words
`zenohrecord`    a recording of a network, and of gateways that run elsewhere
`putting`        what a recording has to put; `playing`: onto a Zenoh network
`facts`          what happened, as records; `gathering`: out of files; `reactions`: who was asked
`figures`        what that amounts to (`reporttext`, `plots`, `page`)
`measuredwater`  the channel of a recording
`whatif`         the load of a trial once more; `changes`: another way (`whatiftext`)
===============  ===================================================================================
"""
