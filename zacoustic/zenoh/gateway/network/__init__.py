"""The local network of a gateway: its declarations there, and other gateways."""
