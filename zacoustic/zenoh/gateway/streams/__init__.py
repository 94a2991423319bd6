"""What crosses: topics, services and actions, each with its streams."""
