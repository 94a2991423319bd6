"""What happened in a recording, as records."""
