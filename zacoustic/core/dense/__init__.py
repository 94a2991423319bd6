"""Dense frames: typed samples of several streams as one arithmetic-coded string.

A `Speaker` writes the frames of a source and knows what may be referred to; a `Listener` reads them
and says what to acknowledge. Both use a `DenseCodec`, which remembers nothing. In reading order:
`references`, `frame`, `snapshot`, `streamcodec`, `rowmodel`, `leastsquares`, `curve`, `offcurve`,
`arithmetic` with `shares`, `writer` and `reader`; then `layout`, `attitude`, `course`,
`adaptation`, `habits`, `restcodec`, `text` and `spelling`; `prior` and `fitting` for models.
`packedbytes` uses the texts alone.

A nav message of nine fields takes some 0.15 ms at both ends together in pure Python, of which its
airtime is five hundred times as long. Where that matters (many nodes in one process), `mypyc` makes
it less, without a change. How is in docs/design.md.

Invariant: everything that both ends compute alike is integers. Floats are in `fitting`, which one
end does beforehand, and in `attitude`, before rounding and after decoding.
"""

from zacoustic.core.dense.fitting import fit
from zacoustic.core.dense.frame import Decoded, DenseCodec, DenseSample, Encoded
from zacoustic.core.dense.prior import Model, StreamPrior
from zacoustic.core.dense.references import Listener, Speaker
from zacoustic.core.dense.snapshot import Snapshot

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
