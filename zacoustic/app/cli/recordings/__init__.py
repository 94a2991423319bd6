"""Verbs for recordings, frames and journals."""
