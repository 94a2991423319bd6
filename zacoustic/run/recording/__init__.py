"""Recordings: a node's transmissions, receptions and commands, in an MCAP file.

MCAP is the container that ROS 2, Foxglove and others read and write: channels with topic, encoding
and schema; messages with an instant; chunks that can be read one by one. One file serves two
readers. People look at values, frames and events in JSON, or in CDR for streams of ROS, with the
tools that they have. A replay finds every call of the engine, byte for byte.

====================  ==============================================================================
``/N/engine``         boot epochs of node N, and calls of its engine (`life`, `calls`); msgpack
``/N/frames``         frames sent and received, with the modem's measurements
``/N/reports``        the report of each transmission
``/N/links``          changes of the link's state, and its capabilities
``/N/events``         events of the engine for the application
``/N/ledger``         bytes by stream and cause, every ten seconds
``/N/published/KEY``  samples that the node published, as values of their type
``/N/received/KEY``   samples that arrived there
====================  ==============================================================================

`zacoustic record` records a network whose gateways run elsewhere: its samples and values, health
documents and frames. Those files have no ``/N/engine``.

==============  ====================================================================================
`life`          the parameters of an engine, and how to make it again
`calls`         calls as bytes and back
`schemas`       JSON schemas of types and records
`channels`      the channels and their contents; `samples`: those of a recorded network
`writing`       the file, and the thread that writes it
`values`        samples as values of their type, or as messages of ROS
`recorder`      makes recorded engines; `live`: the recording of a running node
`reading`       reads a file, even if its writer has crashed; `epochs`: its boot epochs and calls
==============  ====================================================================================

This package needs the extra `recording`.
"""
