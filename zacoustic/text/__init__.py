"""Text of people: numbers that are read, and what is safe to print."""
