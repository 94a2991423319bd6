"""The program `zacoustic`: its verbs, and what they do."""
