"""Recorded engines made again: checked, run with changes, explained, played onto a network."""
