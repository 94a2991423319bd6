"""Tools to design a fleet: costs, load, types."""
