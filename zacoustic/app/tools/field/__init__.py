"""For whoever is at the modems: is it healthy, who answers, be silent."""
