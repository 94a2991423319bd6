"""Text of people: reading numbers, and safe printing."""
