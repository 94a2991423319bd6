"""Several links used as one: the first that reaches a node, and the next one when it does not."""
