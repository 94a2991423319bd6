"""The protocol of one node, without any input or output: a function of what it is told.

No clock, no thread, no socket, no file and no randomness of its own: instants are arguments called
``now``, randomness is a `random.Random`. The same inputs give the same bytes and the same trace.
It imports with nothing but msgspec and cbor2 installed.

Map, in reading order:

==================================  ================================================================
`clock`, `linktypes`, `events`      what goes in and comes out
`frame`, `envelope`, `age`          the wire (docs/wire.md is normative)
`engine`                            the wiring, and the contract for whoever drives it
`queue`, `qos`, `composer`          what waits, what it is worth, how it becomes a frame
`receiver`, `topics`, `services`,   what arrives, and what becomes of it
`answering`, `calls`, `repeating`
`large`, `objects`                  samples that are larger than a frame
`orders`, `silence`                 what other nodes order; when nothing may be transmitted
`handshake`, `introducing`, `peer`  HELLO: do both ends hold the same table?
`port`, `access`                    the link, and when a frame may start
`demand`                            topics that cross only where somebody has subscribed
`hosttime`                          UTC, as far as the host may be believed
`contact`                           heartbeats, and nodes that are not heard any more
`ranging`, `measurements`           ranges on demand; what the modem measured
`streams`, `keys`                   names ⇄ bytes, and the digest of the table
`types`, `payload`, `encoding`      typed values ⇄ bytes on the water ⇄ bytes at the application
`journal`, `stats`, `trace`         what is to be written down, counted, traced
`tap`, `makeengine`                 every call of an engine, for whoever records it
==================================  ================================================================

Rooms that are left for later versions: `arq` and `objects` beside `topics`, `actions` beside
`services`, `dense` beside `payload`, further policies in `access`.

Invariants:

- What comes off the water never raises and costs bounded memory.
- A sample is decoded only when both ends are known to define its stream in the same way.
- An idle engine has no timer and transmits nothing.
- Every byte given to the link is in the ledger, under a stream and a cause.
"""
