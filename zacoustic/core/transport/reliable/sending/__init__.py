"""The publisher's side: reliable samples under way, their acknowledgements and repetitions."""
