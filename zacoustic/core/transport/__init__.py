"""What two nodes do with each other, end to end: samples, objects, calls, goals, commands."""
