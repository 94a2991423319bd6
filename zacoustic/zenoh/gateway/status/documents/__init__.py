"""Documents of the health report, by subject."""
