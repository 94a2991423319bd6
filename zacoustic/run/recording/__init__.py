"""Recordings: what a node said, heard and was asked for, in an MCAP file.

MCAP is what ROS 2, Foxglove and others read and write: channels with a topic, an encoding and a
schema, messages with an instant, in chunks that can be read one by one. So one file serves two
readers. People look at values, frames and events in JSON, or in CDR where the stream is of ROS,
with the tools that they have. And a replay finds every call of the engine, byte for byte.

====================  ==============================================================================
``/N/engine``         each life of node N, and each call of its engine (`life`, `calls`); msgpack
``/N/frames``         frames sent and received, with what the modem measured
``/N/reports``        what became of each transmission
``/N/links``          the link goes up or down, and what it can do
``/N/events``         what the engine told the application
``/N/ledger``         bytes by stream and cause, now and then
``/N/published/KEY``  samples that the node published, as values of their type
``/N/received/KEY``   samples that arrived there
====================  ==============================================================================

`zacoustic record` writes, of a network whose gateways run elsewhere, the samples and values on it,
health documents and frames; those files have no ``/N/engine``.

==============  ====================================================================================
`life`          what an engine is made of, and the same engine made again
`calls`         calls as bytes and back
`schemas`       JSON schemas of types and records
`channels`      which channel holds what; `samples`: those of a recorded network
`writing`       the file, and the thread that writes it
`values`        samples as values of their type, or as messages of ROS
`recorder`      makes engines that are recorded; `live`: that of a node that runs
`reading`       a file, also one whose writer has crashed
==============  ====================================================================================

It needs the extra `recording`.
"""
