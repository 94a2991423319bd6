"""Pages for a browser: what they have in common."""
