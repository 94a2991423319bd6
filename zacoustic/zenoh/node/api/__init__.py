"""The interface of a program: the node, its publishers, subscriptions, clients and services."""
