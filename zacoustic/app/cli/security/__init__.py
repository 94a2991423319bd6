"""Verbs for keys and permissions."""
