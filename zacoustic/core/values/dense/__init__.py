"""Dense blocks: typed samples of several streams as one arithmetic-coded block.

A `Speaker` writes a source's blocks and knows what they may refer to; a `Listener` reads them and
returns what to acknowledge. Both use a `DenseCodec`, which keeps no state. This package calls a
block a frame. In reading order:

- `stream`: `references`, `frame`, `streamcodec`, `restcodec`; `packedbytes` uses only the texts.
- `model`: `snapshot`, `rowmodel`, `leastsquares`, `layout`, `attitude`, `course`, `adaptation`,
  `habits`; `prior`, which `fitting` makes.
- `text`: `text`, `spelling`, `examples`, `lines`.
- `coder`: `arithmetic` with `shares`, `writer` and `reader`; `curve` and `offcurve`.

A nav message of nine fields takes about 0.15 ms for both ends together in pure Python; its airtime
is five hundred times as long. For many nodes in one process, `mypyc` makes it faster without a
change (docs/design.md).

Invariant: everything that both ends must compute alike is integers. Floats are in `fitting`, which
one end does beforehand, and in `attitude`, before rounding and after decoding.
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
