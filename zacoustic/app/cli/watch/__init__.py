"""Verbs that show what a gateway does."""
