"""The protocol of one node, without any input or output of its own: a function of its inputs.

No clock, no thread, no socket, no file and no randomness of its own: instants are arguments called
``now``, randomness is a `random.Random`. The same inputs give the same bytes and the same trace.
It imports with nothing but msgspec and cbor2 installed.

Eleven layers; each imports only from those below (import-linter checks that in `make test`):

==============  ====================================================================================
`engine`        the contract for the shell that drives a node, and the wiring: `engine`,
                `makeengine`; `linkstack` is a node on one link, `routeports` its routes, which are
                links to their ends, `bondports` its bonds, which are links to their streams,
                `floodport` its flooded streams, and `forwarding` what of these goes over a link;
                `commands` use the link of their stream; `events` is the engine's output, `tap`
                records its calls
`profiles`      which transports a node speaks, and how a frame is decoded: `native`, `rmw_desert`,
                each a `profile`; `rules` has the rules of the config, `entities` those of discovery
`transport`     the mechanisms between two nodes, end to end: `topics`, `reliable`, `objects`,
                `subscriptions`, `calls`, `actions`, `commands`, `carry`; `exchanges` is what all
                that ask and answer have in common; `status` answers what a node is asked before a
                dive, `keydelivery` sends keys for broadcasts, `routing` has the commands about
                routes; `publication` is what a program publishes, `deliveries` has the events of
                samples, `outcomes` their ends over restarts; `contract` is for third-party
                transports
`relay`         frames of routes over other nodes: a `route`, a `flow` for each direction of it with
                the frames in `custody`, the `turns` that its trains take; `relay` is a source of
                the composer; `prober` measures who hears whom, `paths` has changed paths;
                `flooding` passes frames on without a route, as `flood` says; a `tunnel` is what
                both are as links
`bond`          several links used as one: `spec` lists them, `bonding` has a node's part,
                `policy` chooses for each frame, `reach` tells whether a link reaches a node,
                `outbox` is a source of the composer
`schedule`      `context` is what components share in a node, and on each link; `queue` to
                `frames`, by `composer` and `filling`, to `port` (`bulkwindow`, `othertrains`) and
                `transmitter`;
                `gate` decides when a frame goes, by reasons of `port`, `access`, `airtime` and
                `silence`, which needs `hosttime`; `timing`, `pacers` and `copies` how often; `ways`
                tell how far a node is, `hopage` how long a frame was on its way by other links;
                `replybudget` limits what another node causes;
                `linkseal` closes a frame; `hearing` is what frames say about the medium; `sources`
                and `savings` are what a frame is composed from beside the queue
`peers`         what is known of each other node: `peers` has a `peer` for each, `states` their
                tables; `handshake`, `owing`, `introducing`, `contact`, `lostcontact`, `heartbeats`,
                `bootepoch`, `ranging`, `measurements`, `lives`; `peerrules` and `agreementpolicy`
                are the settings; `doubt` is what this node does not know of itself, `twins` which
                addresses two nodes have; `sealing` seals frames and opens each once (`replay`),
                `alarms` report what does not open;
                `statements` are
                what a frame says about its sender, `reception` dispatches the rest of it
`wire`          grammar only: `envelope`, `seal`, `frame`, `content`, the table of `controls`;
                `access`, `agreement`, `bond`, `calls`, `carry`, `exchanges`, `flood`, `goals`,
                `numbers`, `objects`, `relay`, `routing`, `subscriptions`
                (docs/wire.md is normative)
`streams`       what both ends agree on: `specs`, `keys`, `table` and its digest, `wireprofile`;
                `commands`, `status`, `keydelivery` and `routing` are in every table, `carry` in
                some, `rmwdesert` says which streams it allows
`values`        typed values to bytes and back: `types`, `payload`, `dense`, `rmw_desert`,
                `encoding`, `age`
`base`          `clock`, `timers`, `generators` of random numbers, `linktypes`, `linkids`,
                `moments` that outlast a restart, `parts` of frames, `qos`, `journal`, `signals`,
                `sizes`, `stats`, `trace`; `allowance` is what a silent node may cost, `waits` has
                the words why a frame waits
==============  ====================================================================================

`clock` and `linktypes` are importable from here as well, for links.

Invariants:

- Received bytes never raise an error and cost bounded memory.
- A sample is decoded only when both ends are known to define its stream in the same way.
- An idle engine has no timer and transmits nothing.
- Every byte given to the link is in the ledger, under a stream and a cause.
"""
