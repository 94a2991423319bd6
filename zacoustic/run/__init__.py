"""The runtime: `runner` drives an engine on its links, with journal, recording, logs and clocks."""
