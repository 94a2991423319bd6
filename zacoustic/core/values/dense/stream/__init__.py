"""Samples of streams as one dense block, and what it may refer to."""
