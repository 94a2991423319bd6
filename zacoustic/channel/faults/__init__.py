"""What goes wrong in a scenario: losses, blackouts, faulty nodes, damaged and late frames."""
