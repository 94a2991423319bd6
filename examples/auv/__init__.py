"""A vehicle steered through the water: the experiment of the paper, as an example.

A vehicle with the paper's masses and Fossen's hydrodynamics, a console on the shore, and 1500 m of
water between two S2C modems. Everything that decides something is a function of its inputs and of
the time that it is told, so the same dive runs in real time between processes and in virtual time.

===============================  ===================================================================
`hull`, `hydrodynamics`,         the body in the water: masses, forces, one step of six degrees of
`dynamics`, `world`              freedom; current and sea bed
===============================  ===================================================================
"""
