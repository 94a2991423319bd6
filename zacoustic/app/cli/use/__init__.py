"""Verbs that carry data: a gateway, and one end of a topic, service or action."""
