"""Reliable topics: acknowledged, in order, each sample once; retried until it is worth nothing.

The problem: one frame in ten to one in two is lost, an answer takes seconds, both ends share one
channel, and either of them may lose its memory at any instant. What a publisher is told must hold
all the same: *delivered* means that the other engine has it.

The idea. Each publisher counts the samples of a key: a *number*, of which seven bits stand in the
record. A receiver hands samples on in the order of their numbers, keeps what came too early, and
answers with an ACK: the next number it waits for, and which later ones it holds. Both are ordinary
records that wait in the transmit queue and ride in whatever frame goes next; an ACK lingers for a
moment, so that one answers several samples, and then is a reason for a frame of its own.

Seven bits are enough because of one rule: a sample without SYNC is sent only when it is less than
`WINDOW` numbers ahead of what each of its receivers has acknowledged. Otherwise (a receiver has
never acknowledged, has asked, has begun a new life; or what lies between has expired) the record
begins with SYNC: the *lineage* of the count, which is the boot epoch in which it began, and the
*floor*, the oldest number that may still come. A receiver that does not know the lineage begins at
the floor; one that waits for something older gives it up. Its ACK then begins with SYNC as well:
lineage, and the expected number in full; only after a settling time do short ones count again, so
that none from before is taken for one of now.

What is over needs no word in the usual case: of a stream with depth N, number n says that n - N is
over, since both ends have the depth in their tables.

Who keeps what when a node dies. A receiver of a journalled topic writes its position down before it
hands a sample on and acknowledges it, so nothing is delivered twice by a life that comes later; of
any other topic it writes behind, so that a full disk does not stop a command. In each life it asks
for SYNC first: a position that is an old one does no harm then. A sender whose stream is
journalled writes number and sample down before the first transmission, and goes on in the same
lineage; any other sender begins a new one.

Many may speak at once: five vehicles that all repeat what nobody hears, since all repeat. So
repetitions go in batches of a few frames, then an answer is awaited; without one the next batch
comes later and is smaller, and one answer in a crowd does not end that. And since what has collided
once in one order of frames would collide again, a repetition is answered at a random instant.

Where samples come in a rhythm, silence says less than what is asked for: see `rhythm`.

- `sending`: what is owed to receivers; there `sendlanes` and `sendlane` key by key, `pacing` when
  it is time to repeat, `keeping` what is in the journal.
- `receiving`: what came from publishers; there `watch` asks for what should have come.
- `rhythm`: what both know of when samples come.
- `zacoustic.core.wire.numbers`: the seven bits, SYNC and ACK; `zacoustic.core.schedule.timing`: how
  long an answer takes.
"""
