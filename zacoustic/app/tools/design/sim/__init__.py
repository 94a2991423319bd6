"""`zacoustic sim`: a scenario with its traffic, in virtual time.

`fleetrun` runs the engines of a fleet, `simulation` those of a scenario with its traffic and
result, `randomscenario` those of a random one, `recorder` records them, `text` shows results to
people.
"""
