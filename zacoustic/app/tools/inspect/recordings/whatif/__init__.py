"""The load of a trial again, on a measured or another channel."""
