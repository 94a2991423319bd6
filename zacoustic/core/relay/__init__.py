"""Routes over relays: a frame crosses several hops, and the two ends see one link."""
