"""The dialogue with one modem, sans-IO: `dialogue` is the state machine, `states` its table.

`channel` keeps one command in flight; `startup` finds the modem and makes it ready; `sending`
takes one frame to its one report; `session` is the modem's state and measurements.
"""
