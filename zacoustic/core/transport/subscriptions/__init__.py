"""On-demand topics: samples cross only to nodes that have subscribed.

The problem: a vehicle has more to send than the channel carries, and most of it matters only while
somebody looks. So the samples of an *on-demand* topic go only to nodes that have subscribed, and a
publisher without subscribers sends nothing. Subscriptions change rarely, so each is sent once. It
must stay right whatever is lost, duplicated, late or reordered, and whichever node restarts.

The idea: for each publisher and each *page* of eight streams, a node keeps one *subscribe message*:
the streams that it subscribes to there, and a version that grows with each change. It repeats the
message (`zacoustic.core.transport.exchanges.repeating`) until the publisher repeats it back. A
message is the whole state of its page, so a later one replaces all earlier ones. It has four bytes,
or six with the boot epoch of the publisher; in a frame without room for it beside a TAG, it gives
its turn to the TAG.

The rules of `zacoustic.core.peers.handshake` apply to a message as to a record of the streams that
it names: one from an earlier boot epoch, or one about other streams with the same ids, does not
count. Within an epoch the version decides for a *settling time*: an earlier message may still
arrive that long, and is ignored. After that every other version is new, so a counter of one byte is
never mistaken for its own past.

What each node remembers:

- The publisher keeps the messages, in its journal if it has one, and answers once they are safe. It
  keeps each until the next one, across restarts of either end: a stream does not stop because a
  gateway was restarted.
- A node that hears a new epoch of a publisher sends its subscriptions there again, since the
  publisher may have no journal.
- A node that gets a sample that it has not subscribed to sends its message, since its earlier epoch
  may have subscribed. If the frame is for other nodes too, once in an epoch is enough.

- A publisher that may have forgotten its subscribers shows its boot epoch when a program publishes.

Not covered: the same on a link that costs money. A journal is the remedy.

==============  ====================================================================================
`own`           this node's subscriptions at other nodes
`subscribers`   other nodes' subscriptions at this node
`subscriptions` both of them, for the engine
`announcing`    what a publisher says that may have forgotten its subscribers
==============  ====================================================================================
"""
