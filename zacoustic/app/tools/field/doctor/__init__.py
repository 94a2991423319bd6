"""`zacoustic doctor`: looks for what goes wrong at sea, and names it with the cure.

`doctor` goes through the checks: `network` finds the router and a gateway that runs already,
`running` judges its health report, `host` examines this computer, `ntp` asks a time server;
the plan judges the airtime, and only its link knows the modem (`Link.examine`, `Link.assess`).
`text` shows the findings to people.
"""
