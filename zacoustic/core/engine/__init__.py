"""The contract for whoever drives a node: inputs, commands, outputs; and its wiring."""
