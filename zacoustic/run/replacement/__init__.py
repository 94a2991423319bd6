"""An engine that has raised is replaced by one that goes on from the journal; nobody waits in vain.

- `replacement`: makes the next engine.
- `intact`: of what of the journal an engine can be made, also the first one of a process.
- `faults`: counts, logs, and keeps a frame that raises from taking one engine after the other away.
- `outstanding`: what the application waits for, told where nothing is left of it.
"""
