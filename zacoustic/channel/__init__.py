"""The channel: acoustics as pure functions, and a medium that modems share; no clock, no I/O.

Read in this order::

    scenario     nodes, positions, modems, faults                    what a user writes
      position     places, tracks, paths of sound
      complaint, limits                                              its error messages
    modems       one frame at a time, carrier, acknowledgement       what simple modems do
    driver       puts emissions and receptions on an agenda          for all modems
    agenda       what is to come, in virtual time or by a clock
    medium       transmit → arrivals → receptions                    what a driver calls
      hop          one direction: geometry, level, draws             makes an Arrival
      receiver     one node: overlap, half-duplex, noise             makes a Reception
      arrival      these records
    profiles     modems: airtime, gap, level, error rate             errorcurve: measured ones
    sea          channel models: sea, awgn, none, desert
    fading, loss, faults, randomness                                 what is drawn, reproducibly

    soundspeed, acoustics, noise, modulation, desert                 formulae and their sources

The formulae stand alone and are checked against published values; the medium uses them. A frame
that is lost says why (`arrival.Outcome`). Nothing here depends on the core, and the core does not
know that it exists.
"""
