"""When a frame goes, and what is in it: queue, composer, port, medium access, silence, airtime."""
