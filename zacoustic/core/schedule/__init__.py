"""When a frame goes and what it holds: queue, composer, port, medium access, silence, airtime."""
