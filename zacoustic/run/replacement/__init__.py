"""A new engine replaces one that has raised, and goes on from the journal; no caller waits in vain.

- `replacement`: makes the next engine.
- `intact`: of what of the journal an engine can be made, also the first one of a process.
- `faults`: counts, logs, and keeps a frame that raises from taking one engine after the other away.
- `outstanding`: what the application waits for; reports what is lost.
"""
