"""Tools to test links and applications, shipped so that third parties can use them.

`virtual` runs many real engines on the simulated channel in virtual time, with crashes; `scenarios`
has random scenarios and their invariants; `conformance` is the battery that every link passes.
"""

from zacoustic.testing.virtual import Modem, VirtualNetwork

__all__ = ["Modem", "VirtualNetwork"]
