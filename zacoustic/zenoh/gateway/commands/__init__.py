"""Requests to the gateway itself: commands, pings, objects."""
