"""What every part of an emulated modem stands on: signals, their durations, settings, sound."""
