"""Verbs for planning a network, before any modem is wet."""
