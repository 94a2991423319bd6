"""Zenoh on this side of the link: a session, the gateway, the node of a program."""
