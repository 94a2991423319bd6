"""Finds the modem and makes it ready."""
