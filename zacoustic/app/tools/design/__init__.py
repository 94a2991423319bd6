"""For whoever designs a fleet: what it costs, whether it fits, what its types are."""
