"""A node that reaches its gateway over Zenoh."""
