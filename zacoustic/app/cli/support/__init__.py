"""What verbs share: arguments, output, progress, exit at work."""
