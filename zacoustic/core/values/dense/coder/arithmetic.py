"""An arithmetic coder: symbols of any probability as one string, to a fraction of a bit each.

The problem: a field whose next value is almost known is worth a tenth of a bit, and whole bits per
field cost ten times that. The idea: the string is a number between 0 and 1; every symbol narrows
the interval in which it must lie to the symbol's share of it. Whoever knows the shares finds the
symbols again by looking in which share the number lies.

`Writer` and `Reader` have the same methods, and each *returns the value*: the writer the one that
it is given, the reader the one that it found. So a model is one piece of code that both ends run
(``depth = coder.uniform(size, depth)``), and cannot say one thing to the writer and another to the
reader.

All arithmetic is on integers. The writer keeps the lower end as one integer of any length, so a
carry needs no care; the width is kept at 48 bits, 28 of which a symbol's share may divide. Numbers
on a curve divide it by as much as all their shares are together.

The end. A string of n bytes stands for the number that it is followed by zeros. Of the strings of
the shortest sufficient length, several may lie in the interval: which of them is sent is a choice
that costs nothing, and is used as a check (`Writer.finish`, `Reader.check`): a number of at least
`ways` values and as many as there happen to be, mod a hash of both ends' knowledge.

The first byte's two highest bits are the marker of a dense frame, and no part of the number.

Flags, picks and numbers are what every message is made of, and a call costs as much as all that
`narrow` does: so these do it themselves.
"""

from zacoustic.core.values.dense.coder.reader import Reader
from zacoustic.core.values.dense.coder.writer import Writer

Coder = Writer | Reader
"""What models are written for.

Both have `flag`, `uniform`, `raw`, `choice`, `pick`, `number` and `near`.
"""
