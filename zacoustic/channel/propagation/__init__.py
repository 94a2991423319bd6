"""One sound from one node to another: path, level, fading, and what the receiver makes of it."""
