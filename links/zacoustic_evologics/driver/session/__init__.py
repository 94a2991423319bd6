"""The modem's state and measurements, queries about them, and events for the link."""
