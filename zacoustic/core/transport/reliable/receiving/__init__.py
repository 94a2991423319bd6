"""The subscriber's side: what is there, what is handed on, what is acknowledged."""
