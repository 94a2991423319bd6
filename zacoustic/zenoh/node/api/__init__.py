"""What a program uses: the node, its publishers, subscriptions, clients and services."""
