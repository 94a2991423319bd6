"""Verbs for keys, and for who may do what."""
