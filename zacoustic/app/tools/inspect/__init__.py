"""Tools for afterwards: frames and recordings."""
