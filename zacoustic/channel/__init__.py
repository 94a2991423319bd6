"""The channel: acoustics as pure functions, and a medium that modems share; no clock, no I/O.

Read in this order::

    scenario     nodes, positions, modems, faults                    what a user writes
      traffic      who sends what, for `zacoustic sim`
      problem      its error messages
      tracks       way-points in files
    modems       one frame at a time, carrier, acknowledgement       simple modems
      acknowledgement  the acknowledgement that a modem sends by itself
    driver       puts emissions and receptions on an agenda          for all modems
    agenda       pending actions, in virtual time or by a clock
    medium       transmit → arrivals → receptions                    called by a driver
      arrival      these records
    propagation  one sound from one node to another
      position     places, tracks, paths of sound
      hop          one direction: geometry, level, draws             makes an Arrival
      receiver     one node: overlap, half-duplex, noise             makes a Reception
      sea          channel models: sea, awgn, none, desert
      fading, randomness                                             reproducible random draws
    faults       losses, blackouts, faulty nodes, damage             added by a scenario
    profiles     modems: airtime, gap, level, error rate
    formulae     soundspeed, acoustics, noise, modulation, desert    with their sources
      errorcurve   measured error rates
      errorcurve   measured error rates

The formulae stand alone and are checked against published values; the medium uses them. Each lost
frame has a reason (`arrival.Outcome`). Nothing here depends on the core, and the core does not
depend on this.
"""
