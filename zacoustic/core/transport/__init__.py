"""The mechanisms between two nodes, end to end: samples, objects, calls, goals, commands."""
