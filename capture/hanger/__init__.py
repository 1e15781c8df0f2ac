"""Detect the hanger's two markers in a frame, track them, and compute the hanger's pose."""
