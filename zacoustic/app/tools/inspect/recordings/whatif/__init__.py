"""The load of a trial once more, on a measured or another channel."""
