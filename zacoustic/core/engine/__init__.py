"""The contract for the shell that drives a node: inputs, commands, outputs; and its wiring."""
