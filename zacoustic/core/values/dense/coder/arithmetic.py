"""An arithmetic coder: symbols of any probability as one block, to a fraction of a bit each.

The problem: a field whose next value is almost known is worth a tenth of a bit, and whole bits per
field cost ten times that. The idea: the block is a number between 0 and 1; every symbol narrows the
interval of that number to the symbol's share of it. With the same shares, a reader recovers the
symbols: it looks up in which share the number lies.

`Writer` and `Reader` have the same methods, and each *returns the value*: the writer the given one,
the reader the decoded one. So a model is one piece of code that both ends run (``depth =
coder.uniform(size, depth)``), and the two cannot disagree.

All arithmetic is on integers. The writer keeps the lower end as one integer of any length, so a
carry needs no care; the width is kept at 48 bits, 28 of which a symbol's share may divide. Numbers
on a curve divide it by the sum of all their shares.

The end. A block of n bytes stands for the number that is followed by zeros. Of the blocks of the
shortest sufficient length, several may lie in the interval: the choice among them costs nothing,
and serves as a check (`Writer.finish`, `Reader.check`). There are at least `ways` of them; the
check picks one by a hash of both ends' knowledge, modulo their number.

The first byte's two highest bits are the marker of a dense block, and no part of the number.

Every message consists of flags, picks and numbers, and a call costs as much as all of `narrow`; so
these methods narrow the interval inline.
"""

from zacoustic.core.values.dense.coder.reader import Reader
from zacoustic.core.values.dense.coder.writer import Writer

Coder = Writer | Reader
"""The type that models are written for.  Both classes have `flag`, `uniform`, `raw`, `choice`,
`pick`, `number` and `near`."""
