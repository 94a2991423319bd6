"""What this node knows of every other one: its life, its table, whether it is heard, its range."""
