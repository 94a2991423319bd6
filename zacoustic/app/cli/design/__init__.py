"""Verbs for planning a network before its deployment."""
