"""What a recording amounts to: figures, plots, text, page."""
