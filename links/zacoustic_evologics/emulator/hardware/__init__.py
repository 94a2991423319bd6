"""The basis of all parts of an emulated modem: signals, their durations, settings, sound."""
