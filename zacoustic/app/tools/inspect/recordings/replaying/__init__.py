"""Recorded engines made again: checked, run otherwise, told in words, put onto a network."""
