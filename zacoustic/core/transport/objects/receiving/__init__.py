"""The receiver of an object: what has arrived, what it says of it, how it ends."""
