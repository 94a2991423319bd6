"""The source of an object: its fragments, their order, and what its receivers lack."""
