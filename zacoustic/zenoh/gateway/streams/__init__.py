"""The data that crosses: topics, services and actions."""
