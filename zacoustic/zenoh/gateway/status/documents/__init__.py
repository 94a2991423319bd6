"""Documents of the health report, by what they are about."""
