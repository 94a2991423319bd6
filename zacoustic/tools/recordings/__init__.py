"""What is done with recordings: looked at, checked, played back, tried in another way, reported.

===============  ===================================================================================
`lives`          the lives of nodes in a file, with their calls
`checking`       engines made again: do they say the same bytes?
`otherwise`      the same inputs into engines of another config
`frames`         frames in words
`whatif`         the recorded load on a simulated channel
`playing`        values back onto a Zenoh network
`zenohrecord`    a recording of a network and of a gateway that runs elsewhere
`figures`        what a recording amounts to
`page`           the same as a page with plots
===============  ===================================================================================
"""
