"""A modem with its ports, and their faults."""
