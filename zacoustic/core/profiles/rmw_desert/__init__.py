"""The wire profile `rmw_desert`: what nodes of that ROS 2 middleware say over DESERT.

A vehicle that runs rmw_desert has no HELLO, no acknowledgement, no address and no check. What it
sends is a *packet* with one *message* in it: kind, stream id, for calls a sequence id, and the
fields of a ROS message, nested ones in place, as CBOR items (`zacoustic.core.values.rmw_desert`). A
node whose link speaks this profile says nothing else. Topics are best effort, services are asked
once; what the native wire has besides has no counterpart, and is refused when the streams are
declared (`zacoustic.core.streams.rmwdesert`), by name.

`protocols` is what an engine consists of above such a link. The rules were measured on rmw_desert
4.0.2; docs/rmw_desert.md has them with their limits.
"""
