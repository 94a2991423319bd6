"""`zacoustic sim`: a scenario with its traffic, in virtual time.

`simulation` is a run and what came of it, `randomscenario` a random one, `recorder` puts engines of
a run into a recording, `text` shows results to people.
"""
