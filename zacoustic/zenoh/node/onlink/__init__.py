"""A node with an engine and a link of its own."""
