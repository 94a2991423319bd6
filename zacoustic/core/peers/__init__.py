"""What this node knows of each other node: its boot epoch, table, reachability and range."""
