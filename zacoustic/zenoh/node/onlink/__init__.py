"""A node with its own engine and link."""
