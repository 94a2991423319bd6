"""Tools for after a mission: frames and recordings."""
