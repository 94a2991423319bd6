"""Events of the engine: who takes them, and what people are told."""
