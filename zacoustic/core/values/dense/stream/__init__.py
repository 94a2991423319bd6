"""Samples of streams as one dense block, and the blocks that it may refer to."""
