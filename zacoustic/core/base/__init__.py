"""The base of every layer: instants, the link's types, QoS, journal, statistics, trace."""
