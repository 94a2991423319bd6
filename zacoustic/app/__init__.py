"""The program `zacoustic`: its verbs, and the tools behind them."""
