"""What the verbs for keys and rights do."""
