"""Sound from one node to another: path, level, fading, and its effect at the receiver."""
