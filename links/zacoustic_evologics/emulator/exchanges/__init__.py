"""Deliveries over several signals: instant messages, bursts, their acknowledgements; USBL."""
