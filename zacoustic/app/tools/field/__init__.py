"""Tools for the field: health of a node, ping, remote commands."""
