"""Asking the sensor itself over USB: which devices are there, what their firmware says, lamps and resets."""
