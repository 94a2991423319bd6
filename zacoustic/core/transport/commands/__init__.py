"""Orders over the water: be silent, go on, switch a topic off and on, send it less often.

The problem: whoever orders a vehicle to be silent must not silence it a second time by a frame that
comes late, and must be able to end the silence of a node that cannot answer, not even the question
who is asking. The order must get through, must be obeyed at once, and its answer may cost one frame
at most.

The idea: an order is a call (`zacoustic.core.transport.calls.calls`) of a service that every table
has, and every node serves, under an id of its own (`ORDERS_STREAM_ID`); so it is repeated,
confirmed and answered like any other. What is special:

- The record names the server, since each node is one.
- A frame with an order begins with HELLO, so that a silent node can read it that has been restarted
  and knows nobody. If the tables are not known to be equal it has the row of this stream, too.
- Request and answer say how old they are: a silence "for half an hour" ends half an hour after it
  was ordered, however long it took to get through.
- Orders are counted by who gives them. A node obeys each once, and none that comes behind a later
  one about the same thing (`ledger`), whatever the water brings twice or late; with a journal also
  after a restart.
- An order is obeyed when it arrives, and answered when it is written down. The answer to the order
  that begins a silence is the last frame before it (`Silence.grant`): it goes once, within sixteen
  units (`zacoustic.core.peers.handshake`), or not at all. Later answers wait for its end.

`zacoustic.core.streams.commands` has what is said, `ledger` which order is a new one, `tunings`
what is ordered of topics; `orders` puts them together.
"""
