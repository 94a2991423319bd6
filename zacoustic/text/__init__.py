"""Text from and for people: it reads numbers and prints safely."""
