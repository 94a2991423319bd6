"""A new engine replaces one that has raised and continues from the journal; every caller is told.

- `replacement`: makes the next engine.
- `intact`: the journal entries from which an engine can be made, also the first one of a process.
- `faults`: counts and logs, and keeps a frame that raises from killing one engine after another.
- `outstanding`: what the application waits for; reports what is lost.
"""
