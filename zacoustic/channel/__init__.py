"""The channel: acoustics as pure functions, and a medium that modems share; no clock, no I/O.

Read in this order::

    scenario     nodes, positions, modems, faults                    what a user writes
      traffic      who sends what, for `zacoustic sim`
      problem      its error messages
    modems       one frame at a time, carrier, acknowledgement       what simple modems do
      acknowledgement  what a modem answers by itself
    driver       puts emissions and receptions on an agenda          for all modems
    agenda       what is to come, in virtual time or by a clock
    medium       transmit → arrivals → receptions                    what a driver calls
      arrival      these records
    propagation  one sound from one node to another
      position     places, tracks, paths of sound
      hop          one direction: geometry, level, draws             makes an Arrival
      receiver     one node: overlap, half-duplex, noise             makes a Reception
      sea          channel models: sea, awgn, none, desert
      fading, randomness                                             what is drawn, reproducibly
    faults       losses, blackouts, faulty nodes, damage             what a scenario adds
    profiles     modems: airtime, gap, level, error rate
    formulae     soundspeed, acoustics, noise, modulation, desert    with their sources
      errorcurve   measured error rates

The formulae stand alone and are checked against published values; the medium uses them. A frame
that is lost says why (`arrival.Outcome`). Nothing here depends on the core, and the core does not
know that it exists.
"""
