"""Recordings: a node's transmissions, receptions and commands, in an MCAP file.

MCAP is what ROS 2, Foxglove and others read and write: channels with a topic, an encoding and a
schema, messages with an instant, in chunks that can be read one by one. So one file serves two
readers. People look at values, frames and events in JSON, or in CDR where the stream is of ROS,
with the tools that they have. And a replay finds every call of the engine, byte for byte.

====================  ==============================================================================
``/N/engine``         boot epochs of node N, and calls of its engine (`life`, `calls`); msgpack
``/N/frames``         frames sent and received, with what the modem measured
``/N/reports``        what became of each transmission
``/N/links``          the link goes up or down, and what it can do
``/N/events``         events of the engine for the application
``/N/ledger``         bytes by stream and cause, now and then
``/N/published/KEY``  samples that the node published, as values of their type
``/N/received/KEY``   samples that arrived there
====================  ==============================================================================

`zacoustic record` writes, of a network whose gateways run elsewhere, the samples and values on it,
health documents and frames; those files have no ``/N/engine``.

==============  ====================================================================================
`life`          the parameters of an engine, and the same engine made again
`calls`         calls as bytes and back
`schemas`       JSON schemas of types and records
`channels`      which channel holds what; `samples`: those of a recorded network
`writing`       the file, and the thread that writes it
`values`        samples as values of their type, or as messages of ROS
`recorder`      makes engines that are recorded; `live`: a running node's
`reading`       a file, also one whose writer has crashed
==============  ====================================================================================

It needs the extra `recording`.
"""
