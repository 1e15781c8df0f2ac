"""The limits of a synthetic recording's length, in a module that loads without the simulation."""

SHORTEST_RECORDING = 1.0  # s: duration of the initial rest
SHORTEST_WRITTEN = 4.0  # s of a recording that is written: its hanger then moves for 1.6 s, once to and fro
LONGEST_RECORDING = 120.0  # s of any synthetic motion: its frames are simulated first, a skirt's for 3.5 minutes
