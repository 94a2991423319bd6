"""Events of the engine: their dispatch, and the notices about them."""
