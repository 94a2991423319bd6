"""The erasure code of objects: any sufficient number of fragments gives the block."""
