"""Common parts of pages for a browser."""
