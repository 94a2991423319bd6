"""The publisher's side: what is on its way, what was acknowledged, when it goes again."""
