"""Remote commands: be silent, resume, switch a topic off and on, send it less often.

The problem: a late duplicate of a command must not silence a vehicle a second time, and a command
must end the silence of a node that cannot answer, not even to ask who is calling. The command must
get through and be executed at once, and its answer may cost one frame at most.

The idea: a command is a call (`zacoustic.core.transport.calls.calls`) of a service that every table
has and every node serves, under its own id (`COMMANDS_STREAM_ID`). So it is repeated, confirmed and
answered like any other call. The differences:

- The record names the server, since each node is one.
- A frame with a command begins with HELLO, so that a silent node that has restarted and knows
  nobody can read it. Unless the tables are known to be equal, it also has the row of this stream.
- Request and answer carry their age: a silence "for half an hour" ends half an hour after the
  command was given, however long it took to get through.
- The sender counts its commands. A node executes each once, and none that arrives after a later one
  about the same object (`deduplication`), whatever is duplicated or late; with a journal also after
  a restart.
- A command is executed when it arrives, and answered when it is written down. The answer to the
  command that begins a silence is the last frame before it (`Silence.grant`): it goes once, within
  sixteen units (`zacoustic.core.peers.handshake`), or not at all. Later answers wait for its end.

`zacoustic.core.streams.commands` has the types, `deduplication` decides which command is new,
`overrides` has the overrides of topics; `commands` puts them together.
"""
