"""The host of emulated modems: TCP ports, pseudo-terminals, a clock, and the verb that serves them.

An emulator of one make is an `Emulation`: modems without input and output, in virtual time. It says
how they understand commands and how they sound; everything else is here, for all makes.

===========  ======================================================================================
`modems`     the contract of an emulation: ports, bytes, instants
`running`    an emulation on a loop, at any time scale
`server`     TCP ports and pseudo-terminals of its modems
`verb`       arguments and output that the verbs `zacoustic run modems …` have in common
===========  ======================================================================================
"""

from zacoustic.link.emulation.modems import (
    Emulation,
    ModemDown,
    ModemOutput,
    ModemUp,
    PortBytes,
    PortClosed,
)

__all__ = ["Emulation", "ModemDown", "ModemOutput", "ModemUp", "PortBytes", "PortClosed"]
