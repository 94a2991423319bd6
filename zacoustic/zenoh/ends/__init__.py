"""Ends: one side of a gateway or of a program each, the engine or a Zenoh network.

In reading order:

- `goals`: the contract for goals, and how two Ends are joined;
- `enginegoals`: goals at the engine, from and for the channel;
- `zenohclients`: goals that come from clients on a Zenoh network;
- `zenohservers`: goals for servers on a Zenoh network;
- `calls`, `enginecalls`, `zenohcalls`: the same for calls.
"""
