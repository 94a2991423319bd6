"""Carried topics: other nodes take samples along to subscribers that their publisher cannot reach.

The problem: a mooring and a ship never hear each other, but a glider passes both. What the mooring
publishes must reach the ship once and in order, by whatever way, and the mooring must learn of it.

The idea is that of custody transfer: a sample goes hop by hop as a whole, and whoever has
journalled it answers for it. Each hop is a sample of one reliable topic
(`zacoustic.core.streams.carry`), so `reliable` and `objects` transport it, whatever its size, and
its receiver journals it before it acknowledges it. What is transported is an *envelope*
(`zacoustic.core.wire.carry`): the sample with its publisher, its subscriber and its place in a
count of their own, so nothing depends on the way.

- The publisher keeps a sample until its subscriber has it. It offers the sample to the subscriber
  while it hears that one; otherwise to the nearest *custodian* that it hears; otherwise to all of
  them, and the first that answers gets it.
- A custodian does the same, and forgets the sample once somebody nearer has it. Custodians are in
  the order of their distance from the subscribers, so nothing goes in circles. One that has no room
  refuses, and the publisher asks another one, or the same one later.
- The subscriber delivers the samples of a count in order, each once. It holds a sample until those
  before it have come; the *floor* of an envelope tells which ones will not. It answers what came by
  a custodian with a *receipt*: everything before this number is delivered. Receipts go back by any
  way, the newest one in place of older ones.

A node is in reach if it was heard within `Carry.after_s`. A sample that nobody takes costs what any
reliable sample costs: a frame a minute for each node that it is offered to.

A count begins with each start of its publisher, so no restored journal gives a number to two
samples. Counts do not wait for each other: what was published before and after such a start may
change places if a custodian restarts as well, or if the samples go different ways. To wait would
hold up the newer ones for as long as the older ones are worth carrying. Another count begins if
receipts claim more than was published, for the second time: then somebody else has used it.

- `carrying`: takes and offers; `reach`: who is in reach, and so who gets what; `counts`: the
  publisher's counts; `custody`: what this node keeps; `arrivals`: the subscriber's side.
"""
