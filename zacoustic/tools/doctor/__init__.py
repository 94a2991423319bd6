"""`zacoustic doctor`: looks for what goes wrong at sea, and names it with the cure.

`doctor` goes through the checks: `network` finds the router and a gateway that runs already,
`running` judges what that says of itself, `host` looks at this computer, `ntp` asks a time server;
the plan tells of airtime, and of the modem only its link knows (`Link.examine`, `Link.assess`).
`text` shows the findings to people.
"""
