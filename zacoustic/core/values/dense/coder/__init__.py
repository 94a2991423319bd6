"""The arithmetic coder: writer, reader, curves."""
