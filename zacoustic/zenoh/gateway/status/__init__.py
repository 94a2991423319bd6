"""The gateway's status: health, recent events, metrics."""
