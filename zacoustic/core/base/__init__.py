"""What every layer stands on: instants, the link's types, QoS, journal, statistics, trace."""
