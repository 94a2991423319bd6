"""Emulated SBD modems, and the provider's gateway behind them."""
