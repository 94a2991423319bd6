"""One frame and its one report: `sending` is the state machine, `states` its table."""
