"""Events of a recording, as records."""
