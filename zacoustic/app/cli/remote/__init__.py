"""Verbs that command a node."""
