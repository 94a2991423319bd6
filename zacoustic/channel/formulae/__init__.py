"""Sound and modems as formulae, each with its source: speed, absorption, noise, error rates."""
