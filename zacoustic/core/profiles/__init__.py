"""Wire profiles: which transports a node speaks, and how a frame is taken apart."""
