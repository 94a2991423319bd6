"""Recorded telemetry: models fitted to it, and the bytes it takes.

=============  =====================================================================================
`lines`        a recording as lines: time, name, content; `mcaplines`: a recording in MCAP
`names`        the stream that a name in a recording means
`values`       the content of a line as a value of its type; when a decoded value is right
`recording`    the recordings of a fleet's streams, by vehicle
`exchange`     a vehicle and a listener, over a channel that loses frames
`modelling`    a model from recordings, and whether it helps
`measuring`    the bytes of every codec, with all decodes verified
=============  =====================================================================================

`modeltext` and `measuretext` format the results of the last two for people.
"""
