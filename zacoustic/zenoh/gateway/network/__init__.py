"""The local network of a gateway: what it declares there, and whom it sees."""
