"""The erasure code of objects: enough fragments of a block, whichever they are, restore it."""
