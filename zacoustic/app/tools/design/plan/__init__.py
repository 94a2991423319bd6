"""`zacoustic config plan`: does the traffic fit the channel, and which change would make it fit?

`fleet` and `offers` are the offered traffic, `walk` runs the engines with it in virtual time,
`verdict` evaluates that, `advice` tries changes, `report` is the result, `text` shows it to people.
"""
