"""Formulae of sound and modems, each with its source: speed, absorption, noise, error rates."""
