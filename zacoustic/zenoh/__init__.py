"""Zenoh on this side of the link: the session, the gateway, and the node of a program."""
