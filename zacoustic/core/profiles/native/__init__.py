"""The wire of docs/wire.md."""
