"""What is known of each other node: its life, its table, whether it is heard, how far it is."""
