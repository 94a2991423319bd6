"""`zacoustic config plan`: does the traffic fit the channel, and which change would make it fit?

`fleet` and `offers` are the offered traffic, `walk` is a model of it (its parts are `speaker`,
`items`, `reliable`, `calls`, `transfers`), `verdict` evaluates it, `advice` tries changes, `report`
is the result, `text` shows it to people.
"""
