"""Remote commands: transmit silence, resume, switch a topic off and on, limit its rate.

The problem: a late duplicate of a command must not silence a vehicle a second time, and a command
must end the silence of a node that cannot answer, not even to ask who is calling. The command must
get through and be executed at once, and its answer may cost one frame at most.

The idea: a command is a call (`zacoustic.core.transport.calls.calls`) of a service that every table
has and every node serves, under an id of its own (`COMMANDS_STREAM_ID`). So it is repeated,
confirmed and answered like any other call. The differences:

- The record names the server, since each node is one.
- A frame with a command begins with HELLO, so that a silent node that has restarted and knows
  nobody can read it. Unless the tables are known to be equal, it also has the row of this stream.
- Request and answer carry their age: a silence "for half an hour" ends half an hour after the
  command was given, however long it took to get through.
- The sender counts its commands. A node executes each once, and none that arrives after a later one
  about the same object (`deduplication`), whatever is duplicated or late; with a journal this holds
  across restarts.
- A node executes a command when it arrives, and answers once the journal has it. The answer to the
  command that begins a silence is the last frame before it (`Silence.grant`): it is sent once,
  within sixteen units (`zacoustic.core.peers.handshake`), or not at all. Later answers wait for the
  end of the silence.

`zacoustic.core.streams.commands` has the types, `deduplication` decides which command is new,
`overrides` holds the overrides of topics, `unproved` limits commands of unproved senders, `given`
sends commands, and `commands` joins them.
"""
