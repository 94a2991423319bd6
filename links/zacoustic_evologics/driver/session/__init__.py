"""The modem's state and measurements, what is asked of it, and what goes to the link."""
