"""One emulated modem, sans-IO: commands of its host, and received signals."""
