"""Topics: best-effort samples, alone or in dense blocks, and deadlines."""
