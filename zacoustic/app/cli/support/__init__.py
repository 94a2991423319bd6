"""Shared parts of verbs: arguments, output, progress."""
