"""Wire profiles: the transports that a node speaks, and how a frame is decoded."""
