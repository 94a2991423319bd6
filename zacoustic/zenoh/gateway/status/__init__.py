"""What the gateway says of itself: health, recent events, metrics."""
