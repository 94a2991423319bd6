"""`zacoustic plan`: does the traffic fit the channel, and if not, what would make it fit?

`fleet` and `offers` are the offered traffic, `walk` is a model of it (`speaker`, `items`,
`reliable`, `calls`, `transfers` are its parts), `verdict` judges it, `advice` tries changes,
`report` is what comes of all that, `text` shows it to people.
"""
