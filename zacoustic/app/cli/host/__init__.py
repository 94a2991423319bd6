"""Verbs about this computer."""
