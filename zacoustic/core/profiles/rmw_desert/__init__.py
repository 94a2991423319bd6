"""The wire profile `rmw_desert`: what nodes with that ROS 2 middleware transmit over DESERT.

rmw_desert has no HELLO, no acknowledgement, no address and no check. A node sends a *packet* with
one *message* in it: kind, stream id, a sequence id for calls, and the fields of a ROS message,
nested ones in place, as CBOR items (`zacoustic.core.values.rmw_desert`). A node whose link speaks
this profile transmits nothing else. Topics are best effort, and a service request is sent once.
Everything else of the native wire has no counterpart, and declaring such streams is refused by name
(`zacoustic.core.streams.rmwdesert`).

`protocols` has the components of an engine above such a link. The rules were measured on rmw_desert
4.0.2; docs/rmw_desert.md has them with their limits.
"""
