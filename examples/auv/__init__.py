"""A vehicle steered through an acoustic channel: the experiment of the paper, as an example.

A vehicle with the paper's masses and Fossen's hydrodynamics, a console on the shore, and 1500 m of
water between two S2C modems. Everything that decides something is a function of its inputs and of
the time that it is told, so the same dive runs in real time between processes and in virtual time.

==============================  ====================================================================
`hull`, `hydrodynamics`,        the body in the water: masses, forces, one step of six degrees of
`dynamics`, `world`             freedom; current and sea bed
`sensors`, `navigator`,         what the vehicle measures, where it believes to be, how it holds a
`autopilot`, `picture`          course and finds a way-point; what its camera sees
`craft`                         the vehicle as a whole: commands in, reports out
`messages`, `fleet.json5`,      what crosses the water, as classes and as the gateways' file; where
`start`, `water.json5`          the dive begins; the water
`shore`, `dive`                 what the shore knows, how it gives orders; the scripted dive
`virtual`                       all of that on real engines in virtual time
`session`, `vehicle`,           the same as Zenoh clients, in processes of their own, between
`zenohshore`, `expedition`,     emulated modems; the scripted dive there
`headless`
`setpoints`, `fates`,           the console: set-points at a rate that the water carries, and what
`linkwatch`, `controlstation`,  became of them; what the gateway tells of link and water; everything
`readout`, `drawing`, `ladder`, the operator does and reads; pictures; its page, its looks and keys;
`look`, `page`, `console`       and all of that with the processes behind it
==============================  ====================================================================
"""
