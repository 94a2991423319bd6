"""One emulated modem, sans-IO: what its host asks of it, and what it hears."""
