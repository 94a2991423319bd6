"""Recorded telemetry: what a fit finds in it, and how many bytes it takes.

=============  =====================================================================================
`lines`        a recording as lines: time, name, content; `mcaplines`: one in MCAP
`names`        which stream a name in a recording means
`values`       the content of a line as a value of its type; when a decoded value is right
`recording`    the recordings of a fleet's streams, by vehicle
`exchange`     a vehicle and a listener, over a channel that loses frames
`modelling`    a model out of recordings, and whether it helps
`measuring`    the bytes of every codec, with all decodes verified
=============  =====================================================================================

`modeltext` and `measuretext` make texts for people of what the last two return.
"""
