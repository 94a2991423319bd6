"""Verbs that show the state of gateways."""
