"""Dense blocks: typed samples of several streams as one arithmetic-coded block.

A `Speaker` writes the blocks of a source and knows what they may refer to; a `Listener` reads them
and returns what to acknowledge. Both use a `DenseCodec`, which remembers nothing. In this package a
block is called a frame. In reading order:

- `stream`: `references`, `frame`, `streamcodec`, `restcodec`; `packedbytes` uses the texts alone.
- `model`: `snapshot`, `rowmodel`, `leastsquares`, `layout`, `attitude`, `course`, `adaptation`,
  `habits`; `prior`, which is made by `fitting`.
- `text`: `text`, `spelling`, `examples`, `lines`.
- `coder`: `arithmetic` with `shares`, `writer` and `reader`; `curve` and `offcurve`.

A nav message of nine fields takes some 0.15 ms at both ends together in pure Python; its airtime is
five hundred times as long. For many nodes in one process, `mypyc` makes it faster without a change
(docs/design.md).

Invariant: everything that both ends compute alike is integers. Floats are in `fitting`, which one
end does beforehand, and in `attitude`, before rounding and after decoding.
"""

from zacoustic.core.values.dense.fitting import fit
from zacoustic.core.values.dense.model.prior import Model, StreamPrior
from zacoustic.core.values.dense.model.snapshot import Snapshot
from zacoustic.core.values.dense.stream.frame import Decoded, DenseCodec, DenseSample, Encoded
from zacoustic.core.values.dense.stream.references import Listener, Speaker

__all__ = [
    "Decoded",
    "DenseCodec",
    "DenseSample",
    "Encoded",
    "Listener",
    "Model",
    "Snapshot",
    "Speaker",
    "StreamPrior",
    "fit",
]
