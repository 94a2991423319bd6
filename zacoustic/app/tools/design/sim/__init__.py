"""`zacoustic sim`: a scenario with its traffic, in virtual time.

`simulation` is a run and its result, `randomscenario` a random one, `recorder` records the engines
of a run, `text` shows results to people.
"""
