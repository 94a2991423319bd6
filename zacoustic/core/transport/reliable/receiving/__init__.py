"""The subscriber's side: samples received, delivered and acknowledged."""
