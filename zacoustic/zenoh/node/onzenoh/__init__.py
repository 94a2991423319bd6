"""A node that reaches its gateway by Zenoh."""
