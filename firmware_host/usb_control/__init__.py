"""Query and control sensors over USB: list devices, read their firmware's data, set lamps, reset."""
