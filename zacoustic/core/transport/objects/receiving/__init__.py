"""The receiver of an object: its fragments, its feedback, its outcome."""
