"""What is asked of the gateway itself: commands, pings, objects."""
