"""The work of the verbs for keys and permissions."""
