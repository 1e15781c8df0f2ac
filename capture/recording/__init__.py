"""Record a take from a sensor: frame order and gaps, tracking, faults, and the condition that the lamp shows."""
