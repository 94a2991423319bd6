"""What runs an engine on a link: `runner`, with journal, recording, permit log and clocks."""
