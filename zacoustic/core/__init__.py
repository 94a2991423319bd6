"""The protocol of one node, without any input or output: a function of what it is told.

No clock, no thread, no socket, no file and no randomness of its own: instants are arguments called
``now``, randomness is a `random.Random`. The same inputs give the same bytes and the same trace.
It imports with nothing but msgspec and cbor2 installed.

Nine layers; each imports only what stands below it (import-linter holds that in `make test`):

==============  ====================================================================================
`engine`        the contract for whoever drives a node, and the wiring: `engine`, `makeengine`;
                `linkstack` is a node on one link, `commands` go by the link of their stream;
                `events` is what it tells, `tap` every call of it, for whoever records it
`profiles`      which transports a node speaks, and how a frame is taken apart: `native`,
                `rmw_desert`, each a `profile`; `rules` is what the config says, `entities` what
                discovery speaks of
`transport`     what two nodes do with each other, end to end: `topics`, `reliable`, `objects`,
                `subscriptions`, `calls`, `actions`, `commands`; `repeating` until there is an
                answer, `deliveries` is what becomes of samples; `contract` for a transport of
                somebody else
`schedule`      `context` is what a node has once, and on each link; `queue` to `composer` and
                `filling` to `port` to `transmitter`; `access`, `airtime`, `silence` and `hosttime`
                say when; `timing`, `pacers` and `copies` how often; `linkseal` closes a frame;
                `hearing` is what frames say of the medium; `sources` and `savings` are what a frame
                is composed from beside the queue
`peers`         what is known of each other node: `peers` has a `peer` for each, `states` their
                tables; `handshake`, `introducing`, `contact`, `heartbeats`, `bootepoch`, `ranging`,
                `measurements`, `lives`; `peerrules` and `agreementpolicy` are the settings; `doubt`
                is what this one does not know of itself; `sealing` seals frames and opens each once
                (`replay`), `alarms` tell what does not open; `statements` are what a frame says of
                its sender, `reception` dispatches the rest of it
`wire`          grammar only: `envelope`, `seal`, `frame`, `content`, the table of `controls`;
                `access`,
                `agreement`, `calls`, `goals`, `numbers`, `objects`, `subscriptions` (docs/wire.md
                is normative)
`streams`       what both ends agree on: `specs`, `keys`, `table` and its digest, `wireprofile`;
                `commands` are in every table, `rmwdesert` says what streams can be there
`values`        typed values to bytes and back: `types`, `payload`, `dense`, `rmw_desert`,
                `encoding`, `age`
`base`          `clock`, `timers`, `generators` of random numbers, `linktypes`, `linkids`,
                `parts` of frames, `qos`, `journal`, `signals`, `stats`, `trace`
==============  ====================================================================================

`clock` and `linktypes` are importable from here as well, for links.

Invariants:

- What comes off the channel never raises and costs bounded memory.
- A sample is decoded only when both ends are known to define its stream in the same way.
- An idle engine has no timer and transmits nothing.
- Every byte given to the link is in the ledger, under a stream and a cause.
"""
