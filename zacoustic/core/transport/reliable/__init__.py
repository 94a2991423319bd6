"""Reliable topics: acknowledged, in order, each sample once, retried while it is worth anything.

The problem: the channel loses one frame in ten to one in two, an answer takes seconds, both ends
share one channel, and either may lose its memory at any instant. Whatever happens, what the
publisher reports must be true: *delivered* means that the other engine has the sample.

The idea: each publisher counts the samples of a key with a *number*, of which the record carries
seven bits. A receiver delivers samples in the order of their numbers, holds those that came too
early, and answers with an ACK: the next number it awaits, and which later ones it holds. Samples
and ACKs are ordinary records that wait in the transmit queue and join the next frame. An ACK
lingers so that it can answer several samples, and then is a reason for a frame of its own.

Seven bits are enough because of one rule: a publisher sends a sample without SYNC only when its
number is less than `WINDOW` ahead of what each of its receivers has acknowledged. Otherwise (a
receiver has never acknowledged, has asked, or has restarted; or the samples in between have
expired) the record begins with SYNC: the *lineage* of the count, which is the boot epoch in which
it began, and the *floor*, the oldest number that may still come. A receiver that does not know the
lineage begins at the floor; one that awaits an older number gives it up. Its ACK then begins with
SYNC as well: lineage, and the expected number in full. Short ACKs count again only after a settling
time, so that no earlier ACK is mistaken for a current one.

Usually the publisher need not say what is over: in a stream of depth N, number n says that n - N is
over, since both ends have the depth in their tables.

What survives a restart: the receiver of a journalled topic journals its position before it delivers
and acknowledges a sample, so no later boot epoch delivers it twice. For any other topic it journals
the position afterwards, so that a full disk does not stop a command. After each restart a receiver
first asks for SYNC, so that an outdated position does no harm. The publisher of a journalled stream
journals number and sample before the first transmission and continues in the same lineage; any
other publisher begins a new one.

Many nodes may transmit at once: five vehicles may all repeat samples that nobody hears because all
of them repeat. So a publisher repeats in batches of a few frames and then awaits an answer. Without
one the next batch comes later and is smaller, and a single answer in a crowd does not end this
back-off. Frames that collided once in some order would collide again in that order, so a repetition
is answered at a random instant.

Where samples come in a rhythm, requests for missing samples tell more than silence: see `rhythm`.

- `sending`: the publisher's side; there `sendlanes` and `sendlane` handle each key, `pacing`
  decides when to repeat, `keeping` is the journal.
- `receiving`: the subscriber's side; there `watch` asks for overdue samples.
- `rhythm`: what both ends know of when samples come.
- `zacoustic.core.wire.numbers`: the seven bits, SYNC and ACK; `zacoustic.core.schedule.timing`: how
  long an answer takes.
"""
