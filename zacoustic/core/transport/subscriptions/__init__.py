"""Topics that cross the water only where somebody has subscribed to them.

The problem: a vehicle has more to say than the water carries, and most of it is of interest only
while somebody looks. So the samples of an *on-demand* topic are sent to nodes that have said that
they want them, and a publisher without such a node sends nothing. What is wanted changes rarely;
so it has to be said once, and be right for ever, whatever is lost, comes twice, late, or in
another order, and whoever restarts meanwhile.

The idea: each node keeps, for each publisher and each *page* of eight streams, one *letter*: which
of them it wants there, and a version that grows with each change. It is repeated to the publisher
(`zacoustic.core.transport.repeating`) until that repeats it back. A letter is the whole truth about
its page, so any later one makes good whatever became of those before. Four bytes carry it, so it
fits beside a TAG into the smallest frame there is.

A letter is read by the rules of `zacoustic.core.peers.handshake`, like a record of the streams that
it
names: what arrives late from a former life, or is said about other streams of the same ids, counts
for nothing. Within a life the version decides, for a *settling time*: so long a letter that was
said before may still arrive, and is ignored. After that every other version is news, so a counter
of one byte never runs into its own past.

Who remembers what:

- The publisher remembers the letters, in its journal if it has one, and answers when they are safe.
  It keeps them until it is told otherwise, over restarts of either end: a stream does not stop
  because a gateway was restarted.
- A node that hears a new epoch of a publisher says again what it wants there: that may be one
  without a journal.
- A node that gets a sample that it does not want says so: its former life may have wanted it. Where
  the frame is for others too, once in its life is enough.

What this does not cover: a publisher without a journal that restarts and says nothing at all. Its
subscribers cannot know. A journal, or a heartbeat, is the remedy.

==============  ====================================================================================
`wishes`        what this node wants of others
`audiences`     what others want of this node
`demand`        both of them, for the engine
==============  ====================================================================================
"""
