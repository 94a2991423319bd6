"""For whoever looks at what happened: frames and recordings."""
