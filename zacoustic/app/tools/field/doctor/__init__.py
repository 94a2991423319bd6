"""`zacoustic config doctor`: looks for faults that will matter at sea, and names their cures.

`doctor` runs the checks: `network` finds the router and a running gateway, `running` evaluates its
health report, `host` examines this computer, `ntp` queries a time server; the plan checks the
airtime, and the link examines the modem (`Link.examine`, `Link.assess`). `text` shows the findings
to people.
"""
