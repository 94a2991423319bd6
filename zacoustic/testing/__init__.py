"""Tools to test links and applications: shipped, so that third parties can use them.

`virtual` runs many real engines on the simulated channel in virtual time, and lets nodes crash;
`scenarios` are random scenarios with their invariants; `conformance` is the battery that every link
passes.
"""

from zacoustic.testing.virtual import Modem, VirtualNetwork

__all__ = ["Modem", "VirtualNetwork"]
