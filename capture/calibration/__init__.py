"""Calibrate a rig from frames at rest: marker distance, depth scale, depth offset, gravity and held ends."""
