"""Text in dense blocks."""
