"""Exchanges: a request crosses, an answer comes back, and each end confirms what it has."""
