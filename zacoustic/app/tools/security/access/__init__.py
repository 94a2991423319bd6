"""Permissions on the local network: from the stream table to Zenoh's access control.

- `grants`: what programs, operators and gateways may do on which key;
- `rules`: the same as Zenoh's `access_control`, with the settings that identify them.
"""
