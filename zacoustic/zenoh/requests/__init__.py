"""Requests to a gateway: one row each, read by the gateway and by all who ask it."""
