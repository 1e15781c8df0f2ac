"""Record a take from a sensor: frames in order, tracking, gaps and faults, the state that the lamp shows."""
