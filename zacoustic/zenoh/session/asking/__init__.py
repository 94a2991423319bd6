"""Queries of both kinds: calls, commands and goals, asked and answered."""
