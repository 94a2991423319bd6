"""The report of a recording: figures, plots, text, page."""
