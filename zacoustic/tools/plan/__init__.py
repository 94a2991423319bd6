"""`zacoustic plan`: does what is to be said fit the channel, and if not, what would make it fit?

`fleet` and `offers` are what is to be said, `walk` is a model of the traffic (`speaker`, `items`,
`reliable`, `calls`, `transfers` are its parts), `verdict` judges it, `advice` tries changes,
`report` is what comes of all that, `text` shows it to people.
"""
