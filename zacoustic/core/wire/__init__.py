"""Grammar only: the bytes of frames, records and controls, as pure functions (docs/wire.md)."""
