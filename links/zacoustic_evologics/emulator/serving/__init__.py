"""Many emulated modems on a loop, behind TCP ports and pseudo-terminals."""
