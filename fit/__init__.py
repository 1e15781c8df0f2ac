"""The workstation: simulate cloth, fit it to takes and diagnose what the simulation still gets wrong."""
