"""On-demand topics: samples cross only to nodes that have subscribed.

The problem: a vehicle has more to send than the channel carries, and most of it matters only while
somebody looks. So the samples of an *on-demand* topic go only to nodes that have subscribed, and a
publisher without subscribers sends nothing. Subscriptions change rarely; so each is sent once, and
must stay right whatever is lost, duplicated, late or reordered, and whichever node restarts
meanwhile.

The idea: each node keeps, for each publisher and each *page* of eight streams, one *subscribe
message*: the streams it subscribes to there, and a version that grows with each change. It repeats
the message to the publisher (`zacoustic.core.transport.repeating`) until that repeats it back. A
message is the whole state of its page, so any later one replaces all before. It has four bytes, so
it fits beside a TAG into the smallest frame.

A message is read by the rules of `zacoustic.core.peers.handshake`, like a record of the streams
that it names: a late one of a former boot epoch, or one about other streams with the same ids, does
not count. Within an epoch the version decides, for a *settling time*: an earlier message may still
arrive for so long, and is ignored. After that every other version is new, so a counter of one byte
never runs into its own past.

What each node remembers:

- The publisher keeps the messages, in its journal if it has one, and answers when they are safe. It
  keeps them until the next one, over restarts of either end: a stream does not stop because a
  gateway was restarted.
- A node that hears a new epoch of a publisher sends its subscriptions there again: the publisher
  may have no journal.
- A node that gets a sample that it has not subscribed to sends its message: its former epoch may
  have subscribed. If the frame is for others too, once in an epoch is enough.

Not covered: a publisher without a journal that restarts and sends nothing at all. Its subscribers
cannot know. A journal, or a heartbeat, is the remedy.

==============  ====================================================================================
`own`        this node's subscriptions at others
`subscribers`     others' subscriptions at this node
`subscriptions`        both of them, for the engine
==============  ====================================================================================
"""
