"""Queries for calls, commands and goals: sent and answered."""
